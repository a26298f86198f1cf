"""`load_stage`: gains and margins with units, changes in memory, and where they go."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

import pytest

import stagectl as sc
from stagectl.api.stage import DesignedStage
from stagectl.config.source import ConfigError
from stagectl.design import DesignError
from stagectl.drives.drive import DriveError
from stagectl.recording.hdf5 import open_recording
from stagectl.service import virtual_drive
from tests.api.conftest import SINE, STAGE
from tests.conftest import CONFIG, movable


def test_it_shows_gains_and_margins(stage: DesignedStage) -> None:
    text = repr(stage)
    for words in ("ball-screw stage A", "proportional Kp", "A/rad", "phase margin 25.8 deg", "Ms"):
        assert words in text
    assert stage.gains["proportional"] == (pytest.approx(833.3, rel=1e-3), "A/rad")
    assert 25.0 < math.degrees(stage.margins.phase) < 26.5 and stage.margins.stable
    assert stage.unrest == "" and stage.period == 5e-4
    assert len(stage.plot().axes) == 2


def test_a_notebook_shows_it_escaped() -> None:
    stage = sc.load_stage(STAGE).changed({"name": "a <b> stage"})
    text = stage._repr_html_()
    assert "a &lt;b&gt; stage" in text and "<b> stage" not in text
    assert text.count("<table>") == 2 and len(text) < 8000


def test_a_change_is_in_memory_until_it_is_saved(stage: DesignedStage, folder: Path) -> None:
    heavier = stage.changed({"mechanics.inertia": 0.0105})
    assert heavier.setup.stage.mechanics.inertia == 0.0105
    assert [change.name for change in heavier.changes] == ["mechanics.inertia"]
    assert "changed in memory" in repr(heavier) and "changed in memory" not in repr(stage)
    assert stage.setup.stage.mechanics.inertia == 0.010
    assert heavier.changed({"mechanics.inertia": 0.0105}) is heavier
    saved = heavier.save("here/heavier.yaml")
    assert saved.setup.stage.mechanics.inertia == 0.0105 and saved.changes == ()
    before, after = STAGE.read_text().splitlines(), (folder / "here/heavier.yaml").read_text().splitlines()
    assert [(old, new) for old, new in zip(before, after, strict=True) if old != new] == [
        ("  inertia: 0.010 kg m^2", "  inertia: 0.0105 kg m^2")
    ]


@pytest.mark.parametrize("speed", [3, 5, 30, 3.0, 12.5])
def test_a_number_is_written_so_that_it_reads_back_as_it_is(stage: DesignedStage, speed: float) -> None:
    assert stage.changed({"limits.speed": speed}).setup.file.limits.speed == pytest.approx(speed, rel=1e-14)
    low, high = stage.changed({"limits.travel": [-speed, speed]}).setup.file.limits.travel
    assert (low, high) == pytest.approx((-speed, speed), rel=1e-14)


def test_a_length_keeps_its_unit_where_it_is_exact(stage: DesignedStage) -> None:
    (change,) = stage.changed({"limits.speed": "200 mm/s"}).changes
    assert change.new == "200 mm/s"


def test_a_recording_holds_the_changed_stage_file(stage: DesignedStage) -> None:
    path = sc.simulate(stage.changed({"mechanics.inertia": 0.0105}), SINE).save("run.h5")
    assert "0.0105 kg m^2" in open_recording(path).meta["files"]["stage"]["text"]


def test_what_must_not_be_is_refused(stage: DesignedStage, folder: Path) -> None:
    with pytest.raises(ConfigError):
        stage.changed({"mechanics.mass": 1.0})
    with pytest.raises(DesignError):
        stage.changed({"control.bandwidth": 300.0})
    with pytest.raises(ConfigError):
        sc.load_stage("none.yaml")
    (folder / "fast.yaml").write_text(movable(STAGE.read_text()).replace("bandwidth: 40 Hz", "bandwidth: 90 Hz"))
    with pytest.raises(DesignError):
        sc.load_stage("fast.yaml")
    assert sc.load_stage("fast.yaml", judged=False).margins.phase < math.radians(20.0)


@pytest.mark.parametrize("place", ["friction.coulomb", "motor.temper", "drive.wire", "controller"])
def test_what_the_model_has_no_place_for_cannot_be_left_unanswered(stage: DesignedStage, place: str) -> None:
    """An entry of a law is none: Stribeck's curve of a bristle stands with the bristle."""
    known = ["residual", "friction.bristle.stribeck"]
    assert stage.changed({"control.unanswered": known}).setup.file.control.unanswered == tuple(known)
    with pytest.raises(ConfigError) as refused:
        stage.changed({"control.unanswered": [place]})
    assert [problem.key for problem in refused.value.problems] == ["control.unanswered"]


def test_another_friction_law_and_an_entry_of_it_in_one_change(stage: DesignedStage) -> None:
    """What a patch of the diagnosis gives: the block, then an entry that only the new law has."""
    law = {"law": "stop-operators", "weight": [0.6, 0.3], "slip": [1e-4, 1e-3]}
    changed = stage.changed({"friction": law, "friction.bristle.coulomb": 0.4, "friction.bristle.range": "0.01 rad"})
    bristle = changed.setup.stage.friction.bristle
    assert bristle.coulomb == pytest.approx(0.4) and bristle.stiffness == pytest.approx(40.0)
    with_units = stage.changed({"friction": {"law": "dahl", "coulomb": "0.5 N m", "range": "10 um", "exponent": 1.0}})
    assert with_units.setup.stage.friction.bristle.coulomb == 0.5


@pytest.mark.parametrize(
    ("entry", "value", "words"),
    [
        ("mechanics.inertai", 0.1, "did you mean mechanics.inertia?"),
        ("mechanics.inertia", -1, "-1 kg m^2; must lie in (0, 1e6] kg m^2"),
        ("mechanics.inertia", "5 mm", "'mm' does not measure kg m^2"),
        ("friction.law", "dahl", "give all of friction as a mapping"),
    ],
)
def test_a_wrong_change_says_why(stage: DesignedStage, entry: str, value: object, words: str) -> None:
    with pytest.raises(ConfigError) as refused:
        stage.changed({entry: value})
    assert words in str(refused.value)


def test_a_change_is_a_number_in_si_or_a_text_with_its_unit(stage: DesignedStage) -> None:
    for value in (0.2, "200 mm/s"):
        speed = stage.changed({"limits.speed": "100 mm/s"}).changed({"limits.speed": value}).setup.file.limits.speed
        assert speed == pytest.approx(0.2 * (2 * math.pi / 0.012 if isinstance(value, str) else 1.0))
    assert stage.changed({"mechanics.inertia": 1}).setup.file.mechanics.inertia == 1.0


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda s: sc.load_stage(s), "path of type DesignedStage; must be a path"),
        (
            lambda s: sc.simulate(s, s),
            "trajectory of type DesignedStage; must be what load_trajectory returned or a path",
        ),
        (lambda s: sc.load_log(3), "path = 3 of type int; must be a path"),  # type: ignore[arg-type]
        (lambda s: sc.compare(s, SINE, ["off", "ptc"]), "must be text, each by itself"),  # type: ignore[arg-type]
        (lambda s: sc.load_stage(SINE), "type belongs to a trajectory file"),
    ],
)
def test_an_argument_of_another_kind_is_named(
    stage: DesignedStage, call: Callable[[DesignedStage], object], words: str
) -> None:
    with pytest.raises(sc.StageError) as refused:
        call(stage)
    assert words in str(refused.value)


def test_a_virtual_drive_needs_a_file(stage: DesignedStage, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(virtual_drive, "answers", lambda _: False)
    monkeypatch.setattr(virtual_drive, "start", lambda *_: pytest.fail("it would be another machine"))
    with pytest.raises(DriveError):
        sc.run(stage.changed({"mechanics.inertia": 0.0105}), SINE)


def test_one_axis_of_several(folder: Path) -> None:
    axis = sc.load_stage(CONFIG / "xy.yaml#y").changed({"mechanics.inertia": 0.013})
    assert axis.setup.stage.mechanics.inertia == 0.013
    assert axis.save("y.yaml").setup.file == axis.setup.file
