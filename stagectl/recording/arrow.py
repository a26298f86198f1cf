"""Arrow, which reads and writes CSV and Parquet: 165 MB that our own recordings do not need."""

from __future__ import annotations

from typing import Any

from stagectl.extras import require


def arrow() -> Any:
    """The package `pyarrow` with its CSV and Parquet.  Raises MissingExtraError."""
    require("tables", "a CSV or Parquet file")
    import pyarrow
    import pyarrow.csv
    import pyarrow.parquet

    return pyarrow
