"""What a session lacks, and what therefore cannot be told from it."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

from stagectl.gap.logs.session import Log, Session


def cannot_tell(session: Session, started: Sequence[bool]) -> tuple[str, ...]:
    """Sentences for what is missing; `started` says of which logs the session's clock is known."""
    logs = session.logs
    return tuple(
        [
            *_columns(session),
            *_controller(session),
            *_repeats([log for log in logs if not log.held_out]),
            *_held_out(logs),
            *_clock(started),
        ]
    )


def _columns(session: Session) -> list[str]:
    logs, found = session.logs, []
    if without := _named([log for log in logs if log.current is None]):
        found.append(
            f"no measured current{without}: what the drive does (delay, gain, limits) cannot be told from what the "
            "mechanics do, and current_gain not from force_constant"
        )
    if without := _named([log for log in logs if log.command is None]):
        found.append(f"no command{without}: neither the controller nor the drive can be checked")
    if without := _named([log for log in logs if log.reference is None]):
        found.append(f"no reference{without}: the loop cannot be simulated, nor its tracking error told")
    if _named([log for log in logs if log.command is None and log.current is None]):
        found.append("neither current nor command: no force is known, and so no effect of the mechanics")
    if session.stage.encoder.step == 0.0:
        found.append("no stage.encoder_step: what the encoder's steps do cannot be told from noise")
    return found


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
        return ["each experiment was recorded once: there is no noise floor, so what does not repeat cannot be told"]
    return [f"{', '.join(single)} was recorded once: its noise floor is that of the other experiments"]


def _held_out(logs: Sequence[Log]) -> list[str]:
    if any(log.held_out for log in logs):
        return []
    return ["no capture is marked `use: held-out`: what is found is not checked on runs that it was not found from"]


def _clock(started: Sequence[bool]) -> list[str]:
    if all(started):
        return []
    return ["the session's clock (start_s) is not known: warming up and wear cannot be told from run to run"]
