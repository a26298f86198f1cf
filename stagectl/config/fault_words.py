"""A fault as words on a command line, read as strictly as one in a stage file."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import yaml

from stagectl.config.loader import ConfigError, Lengths, Reader, Tagged
from stagectl.drives.faults import BLOCKS, FAULT_TYPES
from stagectl.units import StageError


def read_fault(name: str, words: list[str]) -> Any:
    """The fault `name` with parameters such as ``duration=0.5s``.

    Raises StageError with the known names, parameters and ranges.
    """
    if name in FAULT_TYPES and name not in BLOCKS:
        raise StageError(f"{name} happens in the controller, not in a drive: `stagectl selftest` provokes it")
    node: Any = yaml.compose(yaml.safe_dump({"fault": name, **dict(map(_pair, words))}), Loader=yaml.SafeLoader)
    reader = Reader(Path("command line"), Lengths())
    block = reader.value(Annotated[Any, Tagged("fault", BLOCKS)], node, "fault")
    try:
        reader.finish()
    except ConfigError as error:
        raise StageError(str(error).replace(" (command line:1)", "")) from error
    return block


def _pair(word: str) -> tuple[str, str]:
    key, equals, value = word.partition("=")
    if not equals:
        raise StageError(f"{word!r} is no parameter; write it as key=value, such as duration=0.5s")
    return key, value
