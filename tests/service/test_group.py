"""X and Y on one bus as processes: one SYNC, a move of both, and a fault of one that stops both."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from stagectl.drives.bus.embedded import Embedded
from stagectl.drives.bus.frames import frame
from stagectl.web.client import RefusedError
from tests.conftest import CONFIG
from tests.service.serving import Served, lasting

NAMELESS: dict[str, dict[str, Any]] = {  # orders of which an axis that nobody has named would carry out one
    "jog": {"press": 6, "speed": "1 mm/s"},
    "recordings": {"seconds": 1.0},
    "move": {"to": {"": "1 mm"}},
    "trajectory": {"yaml": "{type: sine, amplitude: 1 mm, frequency: 1 Hz, periods: 2}"},
}


@pytest.fixture
def stages(tmp_path: Path) -> tuple[str, ...]:
    """The shipped X-Y stage, one file, with time-outs that a busy machine keeps."""
    return (str(lasting(tmp_path, "xy", source=CONFIG / "xy.yaml")),)


def test_both_move_and_both_stop(tmp_path: Path, stages: tuple[str, ...]) -> None:
    group = Served(tmp_path, stages=stages)
    try:
        group.start()  # it starts its virtual drives itself
        group.ask("POST", "enable")
        for order, body in NAMELESS.items():
            with pytest.raises(RefusedError, match="must name its axis; the axes are: x, y"):
                group.ask("POST", order, **body)
        group.ask("POST", "move", to={"x": "1 mm", "y": "-2 mm"})
        assert group.heard("x")["position"] == pytest.approx(1e-3, abs=3e-7)
        assert group.heard("y")["position"] == pytest.approx(-2e-3, abs=3e-7)
        words = r"limits\.travel = \[-40, 40\] mm; the trajectory from -2 mm needs 41 mm.*xy\.yaml"
        with pytest.raises(RefusedError, match=words):
            group.ask("POST", "move", to={"x": "41 mm", "y": "41 mm"})  # its own limit, and x does not go alone
        assert group.heard("x")["position"] == pytest.approx(1e-3, abs=3e-7)
        group.ask("POST", "move", to={"x": "30 mm", "y": "30 mm"}, speed="5 mm/s", wait=False)
        bus = Embedded(str(tmp_path / "bus"))
        bus.send(frame(0, bytes([0x81, 6])))  # the drive of y boots again
        bus.close()
        fault = group.until(lambda axis: axis["state"] == "fault", name="y")["fault"]
        assert fault in ("rebooted", "drive_fault")  # the second: the other controller's command was seen first
        assert group.until(lambda axis: axis["state"] == "fault", name="x")["fault"] == "partner"
        group.ask("POST", "faults/reset")
        assert [axis["state"] for axis in group.ask("GET", "status")["axes"]] == ["disabled", "disabled"]
    finally:
        group.end()
