"""What each effect's compensation is worth, on a running service whose machine is not its model."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import nullcontext
from pathlib import Path
from typing import Any

import pytest

from stagectl.web.client import RefusedError
from stagectl.workflows.effect_worth import Running, measured
from stagectl.workflows.trials import Shown
from tests.service.serving import Served, lasting

SINE = "{type: sine, amplitude: 2 mm, frequency: 3.2 Hz, periods: 1, ramp: 0.5}"
RIGHT = "viscous_asymmetry: 0.2"


def quiet(_: str, __: int) -> Any:
    return nullcontext(lambda done, total: None)


def having(path: Path, text: Callable[[str], str]) -> Path:
    path.write_text(text(path.read_text()))
    return path


def test_an_effect_that_is_not_there_is_dropped_and_one_that_is_stays(tmp_path: Path) -> None:
    """The model has an asymmetry that the machine has, too, and a cogging that it does not have."""

    def right(text: str) -> str:
        return text.replace("mechanics:\n", f"mechanics:\n  {RIGHT}\n", 1)

    def wrong(text: str) -> str:
        cogging = "  cogging: {amplitude: 0.03 N m, order: 4}\n"
        return right(text).replace("motor:\n", f"motor:\n{cogging}", 1)

    machine = Served(tmp_path, stages=(str(having(lasting(tmp_path, "model"), wrong)),))
    having(machine.stage, right)
    said: list[str] = []
    try:
        machine.start_drive()
        machine.start()
        machine.ask("POST", "enable")
        machine.ask("POST", "home")
        known = {"mechanics.viscous_asymmetry": True, "motor.cogging": True}
        assert machine.ask("GET", "effects") == {"axis": known}
        with pytest.raises(RefusedError, match=r"no effect motor\.temper"):
            machine.ask("PATCH", "effects", unanswered=["motor.temper"])
        running = Running(machine.socket, "axis", {"name": "sine", "yaml": SINE, "tables": {}}, tmp_path / "recorded")
        result = measured(running, (2, 1), False, Shown(said.append, quiet))
        assert result["dropped"] == ["motor.cogging"] and len(result["rounds"]) == 2
        assert machine.ask("GET", "effects")["axis"] == {**known, "motor.cogging": False}
        assert machine.faults() == []
    finally:
        machine.end()
    first, last = (done["errors"]["all"]["rms"]["mean"] for done in result["rounds"])
    assert last < 0.5 * first
    assert any("dropped motor.cogging" in line for line in said)
    assert "the feedback alone answers motor.cogging" in machine.log
