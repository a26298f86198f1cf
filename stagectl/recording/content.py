"""What a file is by its content: a name can be wrong, and a message that trusts it sends the user round in a circle."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from stagectl.recording.constants import SHOWN_CELLS

HDF5_SIGNATURE = b"\x89HDF\r\n\x1a\n"  # HDF5 specification, superblock
_HEAD = 4096  # bytes that tell text from other content


def is_hdf5(path: Path) -> bool:
    """Whether a file begins as HDF5 does."""
    return _head(path).startswith(HDF5_SIGNATURE)


def not_hdf5(path: Path) -> str:
    """Why HDF5 cannot read the file, and what to do."""
    if path.suffix in (".yaml", ".yml"):
        return "is a YAML file, and a recording (.h5) belongs here; `stagectl simulate` makes one"
    if is_hdf5(path):
        return "is an HDF5 file, but damaged; copy it again"
    if _is_text(path):
        return f"holds text and is no HDF5 file; if it is a log, give it the name {path.with_suffix('.csv').name}"
    return "is no HDF5 file; give a recording of stagectl (.h5), or a log as .csv or .mat"


def foreign(names: Iterable[str]) -> str:
    """What to say of an HDF5 file of another program, and of its `names`."""
    listed = ", ".join(names) or "nothing"
    shown = listed if len(listed) <= SHOWN_CELLS else f"{listed[:SHOWN_CELLS]}..."
    return (
        f"is an HDF5 file of another program and no recording of stagectl: it holds {shown}; "
        "save its columns as .csv or .mat, and take `stagectl import` for that file"
    )


def _is_text(path: Path) -> bool:
    try:
        text = _head(path).decode(errors="strict")
    except UnicodeDecodeError as error:
        return error.start > _HEAD - 4 and error.reason == "unexpected end of data"  # a character that is cut
    return "\0" not in text


def _head(path: Path) -> bytes:
    with path.open("rb") as file:
        return file.read(_HEAD)
