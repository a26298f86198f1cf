"""A log of another program in one command: columns by number, the machine by a few values, or a nominal.yaml beside."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from stagectl.gap.logs.load_session import load
from stagectl.gap.logs.session import LogError
from stagectl.gap.logs.sources import Description
from tests.conftest import Command

COLUMNS = {"time": "1", "position": "3:deg", "current": "2:A"}
MODEL: dict[str, float | str] = {"kind": "rotary", "force_constant": 0.05, "inertia": 2e-4}


@pytest.fixture
def log(tmp_path: Path) -> Path:
    """Rows without a header: a rotor of 1e-4 kg m^2 and 5e-4 N m s/rad that swings at two rates, with noise."""
    rng, time = np.random.default_rng(5), np.arange(0.0, 6.0, 1e-3)

    def swing(derivative: int) -> NDArray[np.float64]:
        rates, amplitudes = 2.0 * np.pi * np.array([1.5, 3.7]), np.array([2.0, 0.5])
        parts = amplitudes * rates**derivative * np.sin(np.outer(time, rates) + derivative * np.pi / 2.0)
        return np.asarray(parts.sum(axis=1))

    position, speed, slope = swing(0), swing(1), swing(2)
    current = (1e-4 * slope + 5e-4 * speed) / 0.05 + 2e-3 * rng.standard_normal(len(time))
    rows = np.column_stack([time, current, np.degrees(position + 1e-5 * rng.standard_normal(len(time)))])
    np.savetxt(tmp_path / "swing.csv", rows, delimiter=",", fmt="%.9g")
    return tmp_path / "swing.csv"


def test_the_machine_by_a_few_values_is_that_of_a_nominal_yaml(log: Path) -> None:
    said = load([log], said=Description(COLUMNS, MODEL))
    (log.parent / "nominal.yaml").write_text(json.dumps({"stage": MODEL}))
    beside = load([log], said=Description(COLUMNS))
    assert said.stage == beside.stage and said.stage.mechanics.inertia == MODEL["inertia"]
    assert said.kind == "rotary"
    np.testing.assert_array_equal(said.logs[0].position, beside.logs[0].position)
    assert 2.0 < abs(said.logs[0].position).max() < 2.5  # rad, degrees no longer


def test_one_command_finds_what_is_wrong_with_the_machine(log: Path, command: Command) -> None:
    """Half the inertia, and a viscous friction that the values do not name."""
    columns = ",".join(f"{name}={where}" for name, where in COLUMNS.items())
    values = ",".join(f"{name}={value}" for name, value in MODEL.items())
    out = log.parent / "out"
    code, said, err = command("gap", "diagnose", log, "-o", out, "--columns", columns, "--model", values, "--json", "-")
    assert code == 0, err
    found = {name: value for effect in json.loads(said)["effects"] for name, value in effect["parameters"].items()}
    assert found["inertia"]["value"] == pytest.approx(1e-4, rel=0.03)
    assert 0.0 < found["viscous"]["low"] <= 5e-4 <= found["viscous"]["high"]
    assert (out / "diagnosis.html").stat().st_size > 10_000


@pytest.mark.parametrize("option", ["-o", "--predictions"])
def test_results_that_have_no_place_are_refused_before_the_work(
    log: Path, command: Command, monkeypatch: pytest.MonkeyPatch, option: str
) -> None:
    """A diagnosis takes minutes, and was lost at its end."""
    monkeypatch.setattr("stagectl.diagnose", lambda *_, **__: pytest.fail("the diagnosis has begun"))
    code, _, err = command("gap", "diagnose", log, option, log)
    assert code == 2 and str(log) in err


def test_a_log_without_a_machine_is_refused(log: Path) -> None:
    with pytest.raises(LogError) as refused:
        load([log], said=Description(COLUMNS))
    assert refused.value.reason == "model"


@pytest.mark.parametrize("text", ["kind", "kind=", "=rotary", "kind=rotary,,inertia=1"])
def test_values_that_are_none(log: Path, command: Command, text: str) -> None:
    code, _, err = command("gap", "diagnose", log, "--columns", "time=1,position=3:deg,current=2", "--model", text)
    assert code in (1, 2) and "NAME=VALUE" in err
