"""A negative quantity is a quantity wherever it stands, and an unknown option stays unknown."""

from __future__ import annotations

from typing import Annotated

import pytest
import typer

from stagectl.cli.streams import Verb

app = typer.Typer()


@app.command(cls=Verb)
def verb(
    words: Annotated[list[str], typer.Argument()],
    speed: Annotated[str, typer.Option()] = "",
    by: Annotated[bool, typer.Option("--by")] = False,
) -> None:
    """Say what has come."""
    raise typer.Exit(0 if (words, speed, by) == EXPECTED else 1)


EXPECTED = (["-5 mm"], "-2 mm/s", True)


@pytest.mark.parametrize(
    "typed",
    [
        ["-5 mm", "--speed", "-2 mm/s", "--by"],
        ["--by", "-5 mm", "--speed", "-2 mm/s"],
        ["--speed", "-2 mm/s", "--by", "-5 mm"],
        ["--speed=-2 mm/s", "--by", "--", "-5 mm"],
    ],
)
def test_it_may_stand_anywhere(typed: list[str]) -> None:
    assert app(typed, standalone_mode=False) == 0


def test_an_unknown_option_is_refused() -> None:
    with pytest.raises(typer.TyperException):
        app(["-5 mm", "-x"], standalone_mode=False)
