"""The page of the Python interface, from signatures and docstrings."""

import functools
import inspect
import re
from typing import Any

import stagectl
from stagectl.api.comparison import LayerComparison
from stagectl.api.diagnosis import GapDiagnosis, GapLocation
from stagectl.api.identification import IdentifiedModel
from stagectl.api.record import MotionRecord, RecordFolder
from stagectl.api.stage import DesignedStage
from stagectl.api.trajectory import TrajectorySource
from stagectl.api.tuning import TunedGains

FUNCTIONS = [name for name in stagectl.__all__ if inspect.isfunction(getattr(stagectl, name))]
RESULTS = (
    DesignedStage,
    TrajectorySource,
    MotionRecord,
    RecordFolder,
    IdentifiedModel,
    GapDiagnosis,
    GapLocation,
    TunedGains,
    LayerComparison,
)
_HEAD = """# Python reference

`import stagectl as sc` offers these functions. [From Python](../api.md) shows how to use them.

Numbers are in SI: rad and N m on a rotary axis, m and N on a linear one. Some types in the signatures have short names:

| type | what you pass |
|---|---|
| `StageLike` | a stage as `load_stage` returns it, or the path of a stage file |
| `TrajectoryLike` | a trajectory as `load_trajectory` returns it, the path of its file, or arrays `(time, position)` |
| `DataLike` | a run, a log, or the path of a file or a folder |
| `PathLike` | a `str` or a `pathlib.Path` |
| `Count` | a whole number, 1 or more |
| `Seed` | a whole number; `None`: the seed of the stage file |
| `FrictionLaw` | a function `friction(velocity, position, dt)` that returns a force |
| `ProgressOption` | `True` shows a bar; a function is called with `(done, total)` |
| `Say` | a function that is called with each message |
"""


def pages() -> dict[str, str]:
    """The page by its name."""
    functions = [_function(name, getattr(stagectl, name)) for name in FUNCTIONS]
    return {"reference/api.md": "\n".join([_HEAD, *functions, "## Results\n", *map(_class, RESULTS)])}


def _function(name: str, function: Any) -> str:
    return f"## {name}\n\n```python\nsc.{name}{_signature(function)}\n```\n\n{_text(function)}\n"


def _signature(function: Any) -> str:
    parameters = list(inspect.signature(function).parameters.values())
    words = [re.sub(r": '(.*?)'(?= =|$)", r": \1", str(parameter)) for parameter in parameters]
    keyword = next((k for k, p in enumerate(parameters) if p.kind is inspect.Parameter.KEYWORD_ONLY), None)
    if keyword is not None and not any(p.kind is inspect.Parameter.VAR_POSITIONAL for p in parameters):
        words.insert(keyword, "*")
    line = f"({', '.join(words)})"
    return line if len(line) < 70 else "(\n    " + ",\n    ".join(words) + ",\n)"


def _class(kind: type) -> str:
    rows = [
        f"| `{name}` | {_text(member).splitlines()[0]} |"
        for name, member in inspect.getmembers(kind, _described)
        if not name.startswith("_") and name not in ("count", "index", "sheet") and inspect.getdoc(member)
    ]
    table = ["| member | meaning |", "|---|---|", *rows] if rows and not hasattr(kind, "_fields") else []
    return "\n".join([f"### {kind.__name__}", "", _text(kind), "", *table, ""])


def _described(member: object) -> bool:
    """Methods and properties: the docstring of a plain value is that of its type."""
    return inspect.isroutine(member) or isinstance(member, property | functools.cached_property)


def _text(documented: Any) -> str:
    """The docstring; its double backquotes become single ones, as Markdown has them."""
    return (inspect.getdoc(documented) or "").replace("``", "`")
