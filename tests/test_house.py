"""The ceilings of this house, over every module of `stagectl`: sizes of files and of functions."""

from __future__ import annotations

import ast
import statistics
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import pytest

from tests.conftest import ROOT

FILE_LINES = 290  # a file that would be longer is split in two rooms that have names of their own
MEDIAN, NINETIETH, LONGEST = 8, 17, 60  # lines of a function, from its `def` to its last line

# What stands at the top: nothing else is read there, and what a failed command wrote there is a mistake.
TOP = {
    ".ci", ".gitignore", "LICENSE", "Makefile", "README.md", "config", "docs", "examples", "mkdocs.yml",
    "pyproject.toml", "stagectl", "systemd", "tests", "tools",
}  # fmt: skip

FILES = sorted((ROOT / "stagectl").rglob("*.py"))


class Function(NamedTuple):
    """A function and its size; the tuple sorts by size."""

    lines: int
    name: str
    place: str  # file and line


def _functions(path: Path) -> Iterator[Function]:
    """Functions and methods of a file; a function inside another counts twice, by itself and in the outer one."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            assert node.end_lineno is not None
            lines = node.end_lineno - node.lineno + 1
            yield Function(lines, node.name, f"{path.relative_to(ROOT)}:{node.lineno}")


@pytest.fixture(scope="module")
def functions() -> list[Function]:
    """All functions of the package, the longest last."""
    return sorted(function for path in FILES for function in _functions(path))


def test_the_top_level_holds_what_a_newcomer_expects() -> None:
    """Of what git keeps; a copy without git may hold anything."""
    if not (ROOT / ".git").exists():
        pytest.skip("no repository")
    listed = subprocess.run(
        ["git", "ls-files"], cwd=ROOT, capture_output=True, text=True, check=True
    ).stdout.splitlines()
    assert {path.split("/")[0] for path in listed} == TOP


def test_no_file_is_too_long() -> None:
    sizes = {str(path.relative_to(ROOT)): len(path.read_text(encoding="utf-8").splitlines()) for path in FILES}
    assert len(sizes) > 100  # the package was read
    assert {name: lines for name, lines in sizes.items() if lines >= FILE_LINES} == {}


def test_no_function_is_too_long(functions: list[Function]) -> None:
    assert [function for function in functions if function.lines > LONGEST] == []


def test_most_functions_are_short(functions: list[Function]) -> None:
    lines = [function.lines for function in functions]
    assert statistics.median(lines) <= MEDIAN
    ninetieth = statistics.quantiles(lines, n=10, method="inclusive")[-1]
    assert ninetieth <= NINETIETH, functions[int(0.9 * len(functions)) :]
