"""What ``pip install stagectl`` leaves out: packages that a running axis and the simulator do not need."""

from importlib.util import find_spec
from typing import Any

from stagectl.units import StageError

# Extras of pyproject.toml, and what each brings, by the names under which it is imported.
EXTRAS = {
    "report": ("matplotlib", "jinja2"),
    "tables": ("pyarrow",),
    "service": ("fastapi", "uvicorn", "websockets"),
    "mcap": ("mcap",),
    "mujoco": ("mujoco",),
    "fmu": ("fmpy", "jinja2"),
    "foxglove": ("foxglove",),
    "exam": ("sklearn",),
}


class MissingExtraError(StageError):
    """A package that is not installed, and the extra that brings it."""

    def __init__(self, package: str, extra: str, purpose: str) -> None:
        self.package, self.extra = package, extra
        super().__init__(f"{purpose} needs {package}, which is not installed: pip install 'stagectl[{extra}]'")


def require(extra: str, purpose: str) -> None:
    """Check before the work begins that the packages of `extra` are there; `purpose` begins the error's sentence.

    Raises MissingExtraError.
    """
    for package in EXTRAS[extra]:
        if find_spec(package) is None:
            raise MissingExtraError(package, extra, purpose)


def arrow() -> Any:
    """The package `pyarrow` with its CSV and Parquet.  Raises MissingExtraError."""
    require("tables", "a CSV or Parquet file")
    import pyarrow
    import pyarrow.compute
    import pyarrow.csv
    import pyarrow.parquet

    return pyarrow
