"""The page that all reports share; its template is page.html."""

import hashlib
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

from stagectl.replacing import PAGE, check_replaceable, write_text
from stagectl.web import assets

_UNIT = re.compile(r"([0-9]) (%|[nµm]?(?:m|rad|A|N|s)\b|Hz\b)")


class Picture(NamedTuple):
    """A figure of the page."""

    image: str  # data URI
    caption: str
    least: int = 0  # px below which it is not shrunk, but scrolled
    plot: str = ""  # JSON of its curves over time, of `interactive.picture`
    middle: float = 0.0  # share of its width that is in the middle where it is scrolled


class Table(NamedTuple):
    """A table of the page."""

    title: str
    head: list[str]
    rows: list[list[str]]
    sentences: tuple[int, ...] = ()  # columns that hold text to read, not figures to compare


class Section(NamedTuple):
    """A part of a longer report: text, figures and tables on one subject."""

    title: str
    words: Sequence[str] = ()
    figures: Sequence[Picture] = ()
    tables: Sequence[Table] = ()
    commands: Sequence[str] = ()  # to run next


class Page(NamedTuple):
    """A report; the answer comes first."""

    title: str
    answer: str
    notes: Sequence[str] = ()
    figures: Sequence[Picture] = ()
    tables: Sequence[Table] = ()
    commands: Sequence[str] = ()
    versions: Mapping[str, str] = {}  # of the software behind the results; empty: of what is installed here
    sections: Sequence[Section] = ()  # after the page's own figures and tables
    narrow: bool = False  # figures of one column: three side by side
    filtered: bool = False  # the rows of the sections' tables can be searched
    config: Mapping[str, str] = {}  # text of each configuration file, by its name


def write(page: Page, path: Path, files: Sequence[Path] = ()) -> Path:
    """Write the page as one self-contained file, with the text of its configuration `files`.

    Raises StageError where `path` is no name of a page, or another file than a page of ours is there.
    """
    import jinja2  # a table needs none of these

    from stagectl.recording.metadata import versions

    check_replaceable(path, PAGE)
    config = {**page.config, **{str(file): file.read_text(encoding="utf-8") for file in files}}
    listed = [(name, hashlib.sha256(text.encode()).hexdigest(), text) for name, text in config.items()]
    source = (Path(__file__).parent / "page.html").read_text(encoding="utf-8")
    environment = jinja2.Environment(autoescape=True, undefined=jinja2.StrictUndefined)
    environment.filters["typeset"] = typeset
    given = {**page._asdict(), "config": listed, "library": _library(page), "versions": page.versions or versions()}
    write_text(path, environment.from_string(source).render(given))
    return path


def typeset(text: str) -> str:
    """With an arrow for ``->``, and no line break between a number and its unit."""
    return _UNIT.sub("\\1\u00a0\\2", text.replace(" -> ", "\u00a0→ "))


def _library(page: Page) -> dict[str, str]:
    """The code of its interactive plots; empty where it has none, or uPlot is not installed: then its pictures stay."""
    pictures = [*page.figures, *(picture for section in page.sections for picture in section.figures)]
    folder = assets.available()
    if folder is None or not any(picture.plot for picture in pictures):
        return {}
    own = Path(__file__).parent / "plots.js"
    files = {"style": folder / "uPlot.min.css", "script": folder / "uPlot.min.js", "plots": own}
    return {name: file.read_text(encoding="utf-8") for name, file in files.items()}
