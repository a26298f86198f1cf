"""What a session does not contain, and what therefore cannot be determined from it."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

from stagectl.gap.logs.session import Log, Session


def undetermined(session: Session, started: Sequence[bool]) -> tuple[str, ...]:
    """A sentence for each thing that is missing; `started` holds for each log whether its session clock is known."""
    logs = session.logs
    current, command, reference = (
        _named([log for log in logs if getattr(log, name) is None]) for name in ("current", "command", "reference")
    )
    without_force = any(log.command is None and log.current is None for log in logs)
    sentences = {
        f"no measured current{current}: effects of the drive (delay, gain, limits) cannot be separated from those of "
        "the mechanics, nor current_gain from force_constant": current,
        f"no command{command}: neither the controller nor the drive can be checked": command,
        f"no reference{reference}: the loop cannot be simulated, and its tracking error is not known": reference,
        "neither current nor command: no force is known, and so no effect of the mechanics": without_force,
        "no stage.encoder_step: effects of the encoder's steps cannot be separated from noise": (
            session.stage.encoder.step == 0.0
        ),
        "no deployed controller is known: the command cannot be recomputed, and the gap is that of the effort, not of "
        "the position": session.law is None,
        (once := _recorded_once([log for log in logs if not log.held_out])): once,
        "no capture is marked `use: held-out`: results are not checked on runs that they do not come from": (
            not any(log.held_out for log in logs)
        ),
        "the session clock (start_s) is not known: warming up and wear from run to run cannot be determined": (
            not all(started)
        ),
    }
    return tuple(sentence for sentence, missing in sentences.items() if missing)


def _named(without: Sequence[Log]) -> str:
    """In which logs, in words; empty where in none."""
    names = [log.name for log in without]
    more = f" and {len(names) - 2} more" if len(names) > 2 else ""
    return f" in {', '.join(names[:2])}{more}" if names else ""


def _recorded_once(logs: Sequence[Log]) -> str:
    counted = Counter(log.experiment for log in logs)
    single = [name for name, count in counted.items() if count < 2]
    if single and len(single) == len(counted):
        return "each experiment was recorded once: there is no noise floor, so random variation is not known"
    return f"{', '.join(single)} was recorded once: its noise floor is that of the other experiments" if single else ""
