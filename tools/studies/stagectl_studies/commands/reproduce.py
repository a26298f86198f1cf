"""The command `reproduce`: all figures and tables of a source paper next to our results, on one page."""

import json as jsonlib
from pathlib import Path
from typing import Annotated

import typer

from stagectl.cli.options import Json
from stagectl.cli.show import console, emit
from stagectl.cli.show import progress as bar
from stagectl.extras import require

Paper = Annotated[str, typer.Argument(metavar="PAPER", help="ball-screw or slider.")]
Output = Annotated[Path, typer.Option("--output", "-o", metavar="FOLDER", help="Folder for the page and its numbers.")]


def reproduce(paper: Paper, output: Output = Path("reproduced"), json: Json = None) -> None:
    """Reproduce the experiments of a source paper on a virtual machine: every figure, next to the paper's numbers.

    A table at the top says which figures are reproduced, which differ and why, and which are not drawn and why.
    Takes about a minute; writes FOLDER/PAPER.html and FOLDER/PAPER.json.

    Example: stagectl reproduce ball-screw -o reproduced
    """
    require("report", "the page")
    from stagectl.kernels.jit import cold
    from stagectl_studies.reproduction import papers

    papers.check(paper)
    output.mkdir(parents=True, exist_ok=True)
    if cold():
        console.print("compiling the kernels, once for this version: up to a minute")
    with bar(f"reproduce {paper}", 1) as update:
        outcome = papers.reproduce(paper, update)
        page = papers.page(paper, outcome, output / f"{paper}.html")
    numbers = outcome.numbers()
    (output / f"{paper}.json").write_text(jsonlib.dumps(numbers, indent=2, allow_nan=False) + "\n", encoding="utf-8")
    console.print(f"simulated: {outcome.answer}")
    console.print(f"report: {page}")
    emit(numbers, json)
