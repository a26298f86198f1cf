"""From the friction that a method has found to compensators in the stage file."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from stagectl.compensation.rolling import FORMS
from stagectl.config.friction_laws import friction_of, law_in
from stagectl.identification.capture import IdentificationError, Refusal
from stagectl.identification.result import IdentificationResult


def with_compensators(
    result: IdentificationResult, method: str, acting: str | None, compared: Sequence[str]
) -> IdentificationResult:
    """`result` whose changes hold the compensator that is `acting`, and those to be `compared`, by their names.

    Raises IdentificationError for a name that is none, and where `method` writes no friction into the stage file.
    """
    wanted = [*([acting] if acting else []), *compared]
    if not wanted:
        return result
    check_forms(wanted)
    if "friction" not in result.changes:
        raise IdentificationError(
            f"{method} writes no friction into the stage file, so no compensator is made of it; take simultaneous, "
            "low-speed or friction-models, and a motion with reversals",
            Refusal.UNKNOWN_OPTION,
            value=", ".join(wanted),
        )
    return result._replace(changes={**result.changes, **_blocks(result, acting, compared)})


def check_forms(names: Sequence[str]) -> None:
    """Raises IdentificationError for a name that no compensator has: before the work that ends with one."""
    for name in names:
        if name not in FORMS:
            text = f"no compensator {name!r} can be made of a friction law; must be one of {', '.join(FORMS)}"
            raise IdentificationError(text, Refusal.UNKNOWN_OPTION, value=name, admissible=", ".join(FORMS))


def _blocks(result: IdentificationResult, acting: str | None, compared: Sequence[str]) -> dict[str, Any]:
    from stagectl.compensation import derived  # scipy's parts, which few calls need

    friction = friction_of(law_in(result.changes["friction"]))
    blocks: dict[str, Any] = {}
    if acting:
        blocks["compensation"] = derived.block(acting, friction)
    for name in compared:
        blocks[f"compensators.{name}"] = {k: v for k, v in derived.block(name, friction).items() if k != "form"}
    return blocks
