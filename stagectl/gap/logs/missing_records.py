"""What a session does not contain, and what therefore cannot be determined from it."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

from stagectl.gap.logs.session import Log, Session


def undetermined(session: Session, started: Sequence[bool]) -> tuple[str, ...]:
    """A sentence for each thing that is missing; `started` holds for each log whether its session clock is known."""
    return tuple(
        [
            *_columns(session),
            *_controller(session),
            *_repeats([log for log in session.logs if not log.held_out]),
            *_held_out(session.logs),
            *_clock(started),
        ]
    )


def _columns(session: Session) -> list[str]:
    logs = session.logs
    missing: list[str] = []
    if without := _named([log for log in logs if log.current is None]):
        missing.append(
            f"no measured current{without}: effects of the drive (delay, gain, limits) cannot be separated from those "
            "of the mechanics, nor current_gain from force_constant"
        )
    if without := _named([log for log in logs if log.command is None]):
        missing.append(f"no command{without}: neither the controller nor the drive can be checked")
    if without := _named([log for log in logs if log.reference is None]):
        missing.append(f"no reference{without}: the loop cannot be simulated, and its tracking error is not known")
    if any(log.command is None and log.current is None for log in logs):
        missing.append("neither current nor command: no force is known, and so no effect of the mechanics")
    if session.stage.encoder.step == 0.0:
        missing.append("no stage.encoder_step: effects of the encoder's steps cannot be separated from noise")
    return missing


def _named(without: Sequence[Log]) -> str:
    """In which logs, in words; empty where in none."""
    names = [log.name for log in without]
    if not names:
        return ""
    more = f" and {len(names) - 2} more" if len(names) > 2 else ""
    return f" in {', '.join(names[:2])}{more}"


def _controller(session: Session) -> list[str]:
    if session.law is not None:
        return []
    return [
        "no deployed controller is known: the command cannot be recomputed, and the gap is that of the effort, not of "
        "the position"
    ]


def _repeats(logs: Sequence[Log]) -> list[str]:
    counted = Counter(log.experiment for log in logs)
    single = [name for name, count in counted.items() if count < 2]
    if not single:
        return []
    if len(single) == len(counted):
        return ["each experiment was recorded once: there is no noise floor, so random variation is not known"]
    return [f"{', '.join(single)} was recorded once: its noise floor is that of the other experiments"]


def _held_out(logs: Sequence[Log]) -> list[str]:
    if any(log.held_out for log in logs):
        return []
    return ["no capture is marked `use: held-out`: results are not checked on runs that they do not come from"]


def _clock(started: Sequence[bool]) -> list[str]:
    if all(started):
        return []
    return ["the session clock (start_s) is not known: warming up and wear from run to run cannot be determined"]
