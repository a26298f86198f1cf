"""A fault as words on a command line, read as strictly as one in a stage file."""

from pathlib import Path
from typing import Annotated, Any

import yaml

from stagectl.config.lengths import Lengths
from stagectl.config.loader import Reader
from stagectl.drives.faults import BLOCKS, FAULT_TYPES
from stagectl.problem import Problem, ProblemKind, nearest
from stagectl.units import StageError, Tagged


def read_fault(name: str, words: list[str]) -> Any:
    """The fault `name` with parameters such as ``duration=0.5s``.

    Raises StageError with the known names, parameters and ranges.
    """
    check_fault(name)
    if name not in BLOCKS:
        reason = "happens in the controller, not in a drive"
        raise StageError(Problem(reason, ProblemKind.VALUE, name, remedy="`stagectl selftest` provokes it"))
    node: Any = yaml.compose(yaml.safe_dump({"fault": name, **dict(map(_pair, words))}), Loader=yaml.SafeLoader)
    reader = Reader(Path(), Lengths())
    block = reader.value(Annotated[Any, Tagged("fault", BLOCKS)], node, "fault")
    if reader.problems:  # a command line has no file and no lines
        raise StageError(*(problem._replace(file=None, line=0) for problem in reader.problems))
    return block


def check_fault(name: str, of: str = "fault") -> None:
    """Raise StageError with the faults that may be meant, where there is none of this `name`; `of` is what names it."""
    if name in FAULT_TYPES:
        return
    near = [known for known in FAULT_TYPES if name and name in known] or [nearest(name, list(FAULT_TYPES))]
    remedy = f"did you mean {', '.join(near)}?" if near[0] else "`stagectl inject --list` shows all"
    raise StageError(Problem("is no fault", ProblemKind.UNKNOWN, of, name, remedy=remedy))


def _pair(word: str) -> tuple[str, str]:
    key, equals, value = word.partition("=")
    if not equals:
        remedy = "write it as key=value, such as duration=0.5s"
        raise StageError(Problem(f"{word!r} is not a parameter", ProblemKind.SYNTAX, remedy=remedy))
    return key, value
