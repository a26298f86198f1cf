"""Errors by their type and fields: what a program reads, whatever the words of a message are."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import pytest

from stagectl.problem import Problem
from stagectl.units import StageError


@contextmanager
def refused(type_: type[StageError], /, **fields: Any) -> Iterator[pytest.ExceptionInfo[Any]]:
    """The block raises an error of this type: these `fields` are those of the error or of one of its problems."""
    with pytest.raises(type_) as caught:
        yield caught
    error = caught.value
    assert all(getattr(error, name) == value for name, value in fields.items() if name not in Problem._fields)
    wanted = {name: value for name, value in fields.items() if name in Problem._fields}
    seen = [{name: getattr(problem, name) for name in wanted} for problem in error.problems]
    assert wanted in seen, f"none of {seen} is {wanted}"
