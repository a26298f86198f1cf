"""`identify`, `tune`, `compare` and `diagnose`: what they hold, show, save and apply."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest

import stagectl as sc
from stagectl.api.arguments import ArgumentError
from stagectl.api.diagnosis import GapDiagnosis
from stagectl.api.identification import IdentifiedModel
from stagectl.api.record import MotionRecord
from stagectl.api.stage import DesignedStage
from stagectl.api.tuning import TunedGains
from stagectl.identification.capture import IdentificationError
from stagectl.recording.hdf5 import RecordingError
from stagectl.tuning.families import TuningError
from stagectl.units import StageError
from stagectl.workflows.trials import TrialError
from tests.api.conftest import SINE
from tests.gap.examples import every
from tests.identification.synthetic import TC, J, motion, write_csv


@pytest.fixture
def fit(stage: DesignedStage, folder: Path) -> IdentifiedModel:
    write_csv(folder / "log.csv", motion())
    return sc.identify(stage, "log.csv", method="least-squares")


@pytest.fixture(scope="module")
def tuned(stage: DesignedStage) -> TunedGains:
    return sc.tune(stage, 30.0, "30 deg")


def test_identified_values_have_intervals_and_units(fit: IdentifiedModel) -> None:
    assert 0.98 * J < fit["inertia"].low < fit["inertia"].value < fit["inertia"].high < 1.02 * J
    assert fit["coulomb"].value == pytest.approx(TC, rel=0.02)
    assert {name: fit[name].unit for name in ("inertia", "coulomb")} == {"inertia": "kg m^2", "coulomb": "N m"}
    assert "inertia [kg m^2]" in repr(fit) and "log.csv: 20000 rows" in repr(fit)
    assert fit.to_arrays()["value"][0] == fit["inertia"].value
    assert fit.plot().axes[0].get_ylabel().startswith("position [")


def test_an_identification_changes_a_stage(fit: IdentifiedModel, stage: DesignedStage, folder: Path) -> None:
    assert fit.apply(stage).setup.stage.mechanics.inertia == pytest.approx(fit["inertia"].value, rel=1e-6)
    assert "mechanics.inertia" in [change.name for change in fit.write("mine.yaml")]
    mine = sc.load_stage("mine.yaml")
    assert mine.setup.stage.mechanics.inertia == pytest.approx(fit["inertia"].value, rel=1e-6)
    wrong = IdentifiedModel(fit.method, stage, fit.estimate, fit.captures, (), ("inertia is 11",))
    with pytest.raises(StageError):
        wrong.apply(stage)
    assert wrong.apply(stage, doubtful=True).changes
    assert fit.apply(stage.path).changes == fit.apply(stage).changes


def test_what_is_no_record_is_refused_by_name(stage: DesignedStage) -> None:
    with pytest.raises(ArgumentError) as error:
        sc.identify(stage, 5)  # type: ignore[arg-type]
    assert error.value.name == "data"


def test_an_identification_is_saved(fit: IdentifiedModel) -> None:
    answer = json.loads(fit.save("fit.json").read_text())
    assert answer["parameters"]["inertia"]["value"] == fit["inertia"].value
    with pytest.raises(ArgumentError) as error:
        fit.save("fit.txt")
    assert error.value.name == "path"


def test_identification_from_records_and_paths_together(stage: DesignedStage, folder: Path) -> None:
    write_csv(folder / "log.csv", motion())
    log = sc.load_log("log.csv", stage=stage)
    assert isinstance(log, MotionRecord)
    write_csv(folder / "other.csv", motion(seed=4))
    both = sc.identify(stage, [log, "other.csv"], "least-squares")
    assert len(both.captures) == 2


def test_identification_says_what_is_wrong(stage: DesignedStage, fit: IdentifiedModel) -> None:
    with pytest.raises(IdentificationError):
        sc.identify(stage, "log.csv", "guessing")
    with pytest.raises(IdentificationError):
        sc.identify(stage, "log.csv", "least-squares", seed=3)
    with pytest.raises(IdentificationError) as mistyped:
        sc.identify(stage, "log.csv", "least-squares", gravit=True)
    assert (mistyped.value.value, mistyped.value.admissible) == ("gravit", "gravity")
    with pytest.raises(ArgumentError) as error:
        sc.identify(stage, "log.csv", "simultaneous", delay="2 mm")
    assert (error.value.name, error.value.value) == ("delay", "2 mm")


def test_tuned_gains(tuned: TunedGains, stage: DesignedStage) -> None:
    assert (tuned.bandwidth, tuned.gains["proportional"][1]) == (30.0, "A/rad")
    slower = tuned.apply(stage)
    assert slower.loop.bandwidth == 30.0 and slower.setup.file.control.margin == pytest.approx(math.radians(30.0))
    assert [change.name for change in slower.changes] == ["control.bandwidth", "control.margin"]
    assert "Closed loop" in repr(tuned) and "overshoot" in repr(tuned)
    assert tuned.plot("step").axes[0].get_ylabel() == "position / step"
    with pytest.raises(ArgumentError) as error:
        tuned.plot("root locus")  # type: ignore[arg-type]
    assert error.value.name == "what"


def test_tuning_refuses(stage: DesignedStage) -> None:
    with pytest.raises(TuningError):
        sc.tune(stage, "400 Hz")
    for arguments, name in (({"margin": 3.0}, "margin"), ({"bandwidth": "40"}, "bandwidth"), ({"peak": 0.5}, "ms")):
        with pytest.raises(ArgumentError) as error:
            sc.tune(stage, **arguments)
        assert error.value.name == name


def test_a_comparison(stage: DesignedStage, folder: Path) -> None:
    seen: list[tuple[float, float]] = []
    noisy = stage.changed({"simulation.current_noise": 0.045})
    comparison = sc.compare(
        noisy, SINE, "off", "ptc+friction", repeats=2, folder="there", progress=lambda *step: seen.append(step)
    )
    assert comparison.best == "ptc+friction" and len(comparison.verdict) >= 1
    assert comparison["off"].shape == (2,) and np.all(comparison["off"] > 10.0 * comparison["ptc+friction"])
    assert len(list((folder / "there").glob("*.h5"))) == 4
    assert seen[-1][0] == seen[-1][1] > 0
    assert "ptc+friction" in repr(comparison) and comparison.plot().axes[0].get_xscale() == "log"


def test_a_comparison_refuses(stage: DesignedStage) -> None:
    with pytest.raises(TrialError):
        sc.compare(stage, SINE, "off")
    with pytest.raises(ArgumentError) as error:
        sc.compare(stage, SINE, "off", "ptc", simulate=False, plant=stage)
    assert error.value.name == "plant"


@pytest.mark.parametrize("verdict", sorted(every()))
def test_a_diagnosis_shows_where_which_and_how_far(verdict: str, stage: DesignedStage) -> None:
    diagnosis = every()[verdict]
    answer = GapDiagnosis(Path("session"), diagnosis, None, stage.setup.stage)  # type: ignore[arg-type]
    assert repr(answer).startswith(f"{answer.verdict}: {answer.sentence}")
    assert "nan" not in repr(answer) and "None" not in repr(answer)
    assert set(answer.where.blocks) == {"controller", "drive", "mechanics", "sensor"}
    assert answer.gap is diagnosis.gap and answer.next_experiment is diagnosis.next_experiment
    assert json.loads(answer.save("answer.json").read_text())["verdict"] == answer.verdict
    with pytest.raises(ArgumentError) as error:
        answer.plot("everything")  # type: ignore[arg-type]
    assert error.value.name == "what"


def test_a_diagnosis_of_nothing() -> None:
    Path("session").mkdir()
    with pytest.raises(RecordingError):
        sc.diagnose("session/")
