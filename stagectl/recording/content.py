"""What a file is by its content: a name can be wrong, and a message that trusts it sends the user round in a circle."""

import codecs
from collections.abc import Iterable
from pathlib import Path

from stagectl.recording.constants import SHOWN_CELLS

HDF5_SIGNATURE = b"\x89HDF\r\n\x1a\n"  # HDF5 specification, superblock
_HEAD = 4096  # bytes that tell text from other content
_SHEET = "open the sheet with the log in a spreadsheet, save it as CSV UTF-8, and import that"
_PAGE = (
    "a web page (HTML)",
    "save the log itself, not the page that shows it, or copy its table into a spreadsheet",
)
_KINDS = {  # what begins with these bytes, in lower case, and how it becomes a log
    b"pk\x03\x04": ("an Excel workbook or another zip archive", _SHEET),
    b"\xd0\xcf\x11\xe0": ("an Excel workbook of the old kind", _SHEET),
    b"\x1f\x8b": ("packed by gzip", "unpack it with `gunzip`"),
    b"%pdf": ("a PDF page", "save the log itself as CSV UTF-8"),
    b"<!doctype html": _PAGE,
    b"<html": _PAGE,
}


def is_hdf5(path: Path) -> bool:
    """Whether a file begins as HDF5 does."""
    return _head(path).startswith(HDF5_SIGNATURE)


def stranger(path: Path) -> str:
    """What a file is that is neither text nor data of ours, and how it becomes a log; empty where that is not known."""
    head = _head(path).removeprefix(codecs.BOM_UTF8).lstrip().lower()
    return next((f"is {what}: {how}" for mark, (what, how) in _KINDS.items() if head.startswith(mark)), "")


def not_hdf5(path: Path) -> str:
    """Why HDF5 cannot read the file, and what to do."""
    if path.suffix in (".yaml", ".yml"):
        return "is a YAML file, and a recording (.h5) belongs here; `stagectl simulate` makes one"
    if is_hdf5(path):
        return "is an HDF5 file, but damaged; copy it again"
    if what := stranger(path):
        return what
    if path.suffix in (".csv", ".txt", ".mat"):
        return (
            f"is a log, and a recording belongs here: `stagectl import {path} -o {path.with_suffix('.h5')}` makes one"
        )
    if is_text(path):
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


def is_wide(path: Path) -> bool:
    """Whether a file is text in UTF-16, as spreadsheets save it."""
    return _head(path).startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE))


def is_text(path: Path) -> bool:
    """Whether a file begins as text in UTF-8 does."""
    try:
        text = _head(path).decode(errors="strict")
    except UnicodeDecodeError as error:
        return error.start > _HEAD - 4 and error.reason == "unexpected end of data"  # a character that is cut
    return "\0" not in text


def _head(path: Path) -> bytes:
    with path.open("rb") as file:
        return file.read(_HEAD)
