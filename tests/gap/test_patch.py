"""The patch of a diagnosis: what is named comes into the file, is read back as it was, and the rest stays."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from stagectl.cli import gap_apply
from stagectl.config.friction_laws import Operators, Rolling
from stagectl.config.lengths import Lengths
from stagectl.config.patch import patched
from stagectl.config.source import ConfigError
from stagectl.config.stage_file import load_stage
from stagectl.gap.inference.patch_fields import fields_of
from stagectl.gap.result.diagnosis import UNORDERED, DiagnosisResult, Fields
from stagectl.gap.result.patch import PatchError, applied, parts, patch_of, patch_with, with_choices
from stagectl.gap.result.result_json import save
from stagectl.kernels import effects, friction, friction_bristle
from stagectl.kernels.stage import Stage
from stagectl.units import ROTARY, StageError
from tests.conftest import CONFIG
from tests.gap.examples import ASYMMETRY, COGGING, MICRON, PRESLIDING, SHAPE, VISCOUS, every, found

FOUND = every()
NOMINAL = load_stage(CONFIG / "ball-screw.yaml").stage


@pytest.fixture
def stage(tmp_path: Path) -> Path:
    path = tmp_path / "machine.yaml"
    path.write_text((CONFIG / "ball-screw.yaml").read_text())
    return path


def naming(*fields: tuple[str, float]) -> DiagnosisResult:
    return found("effects", effects=(ASYMMETRY._replace(fields=fields),))


def test_values_come_back_and_all_else_stays_byte_for_byte(stage: Path) -> None:
    before = stage.read_text()
    patch = patch_of(FOUND["effects"], stage)
    saved = applied(patch)
    assert saved is not None and saved.read_text() == before and saved.name == "machine.yaml.bak"
    file = load_stage(stage).file
    assert file.mechanics.bias == pytest.approx(0.031, rel=1e-6)
    assert file.drive.current_lag == pytest.approx(2.5e-4, rel=1e-6)
    after = stage.read_text().splitlines()
    changed = [line for line in after if line not in before.splitlines()]
    assert changed == ["  bias: 0.031 N m", "  current_lag: 0.25 ms             # first order, 1 kHz"]
    assert [line for line in before.splitlines() if line not in after] == [
        "  current_lag: 0.159 ms            # first order, 1 kHz"
    ]


def test_the_diff_says_why(stage: Path) -> None:
    diff = patch_of(FOUND["effects"], stage).diff
    assert diff[0] == "# viscous_asymmetry: viscous asymmetry, 82 % of the closable gap, probability 0.97"
    assert diff[1].endswith("probability 0.61; encoder eccentricity would fit these data as well")
    assert diff[2] == f"--- {stage}" and "+  bias: 0.031 N m" in diff
    assert "-  current_lag: 0.159 ms            # first order, 1 kHz" in diff


def test_blocks_that_are_not_there_yet_are_written_nested_and_read_back(stage: Path) -> None:
    wanted = (
        ("mechanics.viscous_asymmetry", 0.1823),
        ("mechanics.viscous_step.share", 0.2),
        ("mechanics.viscous_step.at", 12.5),
        ("mechanics.viscous_warming.rise", 0.4),
    )
    applied(patch_of(naming(*wanted), stage))
    text = stage.read_text()
    assert (
        "\n  viscous_asymmetry: 0.1823\n  viscous_step:\n    share: 0.2\n    at: 12.5 s\n  viscous_warming:\n" in text
    )
    mechanics = load_stage(stage).file.mechanics
    assert mechanics.viscous_asymmetry == 0.1823 and mechanics.viscous_step == effects.Step(0.2, 12.5)
    assert mechanics.viscous_warming == effects.Warming(0.4)
    applied(patch_of(naming(("mechanics.viscous_step.share", 0.25)), stage))
    assert load_stage(stage).file.mechanics.viscous_step == effects.Step(0.25, 12.5)
    assert len(stage.read_text().splitlines()) == len(text.splitlines())


def test_a_quantity_on_a_block_is_that_of_its_first_field() -> None:
    values = {"motor.cogging.amplitude": 0.02, "motor.cogging.order": 4.0, "motor.cogging.phase": 1.2}
    text = "motor:\n  force_constant: 0.72 N m/A  # plate\nmechanics: {}\n"
    assert patched(text, values, Lengths(ROTARY, 0.012)).text == (
        "motor:\n  force_constant: 0.72 N m/A  # plate\n  cogging:\n    amplitude: 0.02 N m\n    order: 4\n"
        "    phase: 1.2 rad\nmechanics: {}\n"
    )


def test_a_harmonic_comes_back_with_the_unit_of_its_place(stage: Path) -> None:
    wanted = (("motor.cogging.amplitude", 0.0204), ("motor.cogging.order", 4.0), ("motor.cogging.phase", -1.234567))
    applied(patch_of(naming(*wanted), stage))
    motor = load_stage(stage).stage.motor
    np.testing.assert_allclose(motor.cogging, (0.0204, 4.0, -1.234567), rtol=1e-6)
    text = (
        "  force_constant: 0.72 N m/A\n  cogging:\n    amplitude: 0.0204 N m\n    order: 4\n    phase: -1.234567 rad\n"
    )
    assert text in stage.read_text()


def test_another_law_of_friction_replaces_the_block_as_a_whole(stage: Path) -> None:
    patch = patch_of(FOUND["effects+unknown"], stage)
    assert "friction: the law changes from rolling to stop-operators, so its block is replaced as a whole" in (
        patch.comments
    )
    applied(patch)
    law = load_stage(stage).file.friction
    assert isinstance(law, Operators)
    np.testing.assert_allclose(law.weight, (0.3, 0.25, 0.46), rtol=1e-6)
    np.testing.assert_allclose(law.slip, np.multiply((0.25, 1.5, 14.0), MICRON), rtol=1e-6)
    assert law.stribeck == friction.Stribeck(0.12, 4.0)
    assert "# before, rolling: 12 equal stop operators" in stage.read_text()


def test_what_the_new_law_has_as_well_stays_as_it_was_written(stage: Path) -> None:
    text = stage.read_text().replace(
        "  longest: 9 um", "  longest: 9 um\n  stribeck: {rise: 0.30, velocity: 2.0 rad/s} # s"
    )
    stage.write_text(text)
    renamed = PRESLIDING._replace(fields=PRESLIDING.fields[:3])
    applied(patch_of(found("effects", effects=(renamed,)), stage))
    assert "  stribeck: {rise: 0.30, velocity: 2.0 rad/s} # s\n" in stage.read_text()
    law = load_stage(stage).file.friction
    assert isinstance(law, Operators) and law.stribeck == friction.Stribeck(0.3, 2.0)


def test_elements_that_stay_a_rolling_friction_are_written_as_one(stage: Path) -> None:
    weights = NOMINAL.friction.operators
    stretched = friction.bundle([1.2 * x for x in weights.weight], [1.5 * x for x in weights.slip])
    fields = fields_of(NOMINAL, NOMINAL._replace(friction=NOMINAL.friction._replace(operators=stretched)))
    patch = patch_of(found("effects", effects=(PRESLIDING._replace(fields=fields),)), stage)
    assert [str(change) for change in patch.changes] == [
        "friction.coulomb: 1.0 N m -> 1.2 N m",
        "friction.shortest: 0.3 um -> 0.45 um",
        "friction.longest: 9 um -> 13.5 um",
    ]
    applied(patch)
    law = load_stage(stage).file.friction
    assert isinstance(law, Rolling)
    np.testing.assert_allclose(law.operators().weight, stretched.weight, rtol=1e-6)
    np.testing.assert_allclose(law.operators().slip, stretched.slip, rtol=1e-6)


CHANGED = NOMINAL._replace(
    mechanics=NOMINAL.mechanics._replace(viscous=0.17, viscous_asymmetry=0.1),
    motor=NOMINAL.motor._replace(cogging=effects.Harmonic(0.02, 4.0, 1.2)),
    friction=NOMINAL.friction._replace(asymmetry=0.05),
)


@pytest.mark.parametrize(
    ("after", "expected"),
    [
        (NOMINAL, ()),
        (NOMINAL._replace(drive=NOMINAL.drive._replace(current_quantum=0.05)), ()),
        (CHANGED, (("motor.cogging.amplitude", 0.02), ("motor.cogging.order", 4.0), ("motor.cogging.phase", 1.2),
                   ("mechanics.viscous", 0.17), ("mechanics.viscous_asymmetry", 0.1), ("friction.asymmetry", 0.05))),
        (NOMINAL._replace(friction=NOMINAL.friction._replace(
            operators=friction.bundle([0.0], [1.0]), bristle=friction_bristle.Bristle(1.0, 500.0, 2.0))),
         (("friction.law", "dahl"), ("friction.coulomb", 1.0), ("friction.range", 0.002), ("friction.exponent", 2.0))),
        (NOMINAL._replace(friction=NOMINAL.friction._replace(
            operators=friction.bundle([0.0], [1.0]), stribeck=friction.Stribeck(0.7, 2.0),
            bristle=friction_bristle.Bristle(1.0, 500.0, 1.0, 0.02, friction.Stribeck(0.2, 3.0)))),
         (("friction.law", "lugre"), ("friction.coulomb", 1.0), ("friction.range", 0.002), ("friction.damping", 0.02),
          ("friction.stribeck.rise", 0.2), ("friction.stribeck.velocity", 3.0), ("friction.stribeck.shape", 1.0))),
        (NOMINAL._replace(residual=effects.Table(3, -1.0, 0.5, (0.0, 0.1))),
         (("residual.coordinate", "position"), ("residual.start", -1.0), ("residual.step", 0.5),
          ("residual.values", (0.0, 0.1)))),
    ],
)  # fmt: skip
def test_the_difference_of_two_models_as_fields(after: Stage, expected: Fields) -> None:
    assert fields_of(NOMINAL, after) == expected


def test_a_bristle_beside_stop_operators_is_written_and_taken_back(stage: Path) -> None:
    """What the diagnosis fits, the stage file holds: without it the model would lose the form of the friction."""
    both = NOMINAL._replace(friction=NOMINAL.friction._replace(bristle=friction_bristle.Bristle(0.5, 500.0, 2.0)))
    held = patch_with(dict(fields_of(NOMINAL, both)), stage, stage.read_text())
    wanted = dict(fields_of(NOMINAL, both))
    read = dict(fields_of(NOMINAL, load_stage(stage, text=held.after).stage))
    bristle = {name: value for name, value in wanted.items() if "bristle" in name}
    assert len(bristle) == 4 and {name: read[name] for name in bristle} == pytest.approx(bristle, rel=1e-6)
    stage.write_text(held.after)
    alone = patch_with(dict(fields_of(both, NOMINAL)), stage, held.after)
    assert load_stage(stage, text=alone.after).stage.friction.bristle == friction_bristle.NEUTRAL


def test_only_what_is_named_or_asked_for_is_written() -> None:
    weak = COGGING._replace(probability=0.3)
    result = found("effects", effects=(ASYMMETRY, weak))
    assert [part.name for part in parts(result)[0]] == ["viscous_asymmetry"]
    assert [part.name for part in parts(result, ["cogging"])[0]] == ["cogging"]
    with pytest.raises(PatchError) as refused:
        parts(result, ["dwell"])
    assert (refused.value.place, refused.value.value) == ("--only", "dwell")


def test_the_form_of_the_friction_is_written_without_being_a_finding() -> None:
    """It is in the model whose gap the answer gives: without it, the patched model would be another one."""
    law = PRESLIDING.fields
    result = found("none", effects=(), friction=law)
    assert [(part.name, part.fields) for part in parts(result)[0]] == [("friction_form", law)] and result.writes
    result = found("effects", effects=(ASYMMETRY,), friction=law)
    assert [part.name for part in parts(result)[0]] == ["viscous_asymmetry", "friction_form"]
    assert [part.name for part in parts(result, ["viscous_asymmetry"])[0]] == ["viscous_asymmetry"]
    assert [part.name for part in parts(result, ["friction_form"])[0]] == ["friction_form"]


def test_the_unknown_is_written_on_request_only() -> None:
    shape = SHAPE._replace(fields=(("mechanics.bias", 0.02),))
    result = found("effects+unknown", effects=(VISCOUS,), unknown=shape)
    chosen, omitted = parts(result)
    assert [part.name for part in chosen] == ["viscous"] and "--unknown" in omitted[0]
    chosen, omitted = parts(result, unknown=True)
    assert (chosen[-1].name, chosen[-1].fields) == ("unknown", shape.fields) and not omitted
    chosen, omitted = parts(result._replace(unknown=UNORDERED), unknown=True)
    assert [part.name for part in chosen] == ["viscous"] and len(omitted) == 1


@pytest.mark.parametrize(
    ("result", "place", "value"),
    [
        (FOUND["none"], "verdict", "none"),
        (FOUND["controller"], "verdict", "controller"),
        (found("effects", effects=(ASYMMETRY, COGGING._replace(fields=(("mechanics.bias", 0.5),)))),
         "mechanics.bias", 0.5),
        (FOUND["effects"]._replace(travel_per_unit=0.001), "axis.lead", pytest.approx(0.012 / (2.0 * math.pi))),
        (FOUND["effects"]._replace(force_constant=0.36), "motor.force_constant", 0.72),
        (FOUND["foreign"], "axis.kind", "rotary"),
        (naming(("mechanics.bias", math.nan)), "mechanics.bias", pytest.approx(math.nan, nan_ok=True)),
    ],
)  # fmt: skip
def test_what_cannot_be_patched_is_refused(result: DiagnosisResult, place: str, value: object, stage: Path) -> None:
    before = stage.read_text()
    with pytest.raises(PatchError) as refused:
        patch_of(result, stage)
    assert (refused.value.place, refused.value.value) == (place, value)
    assert stage.read_text() == before


def test_a_place_that_no_stage_file_has_is_refused(stage: Path) -> None:
    with pytest.raises(ConfigError, match=r"mechanics\.mass"):
        patch_of(naming(("mechanics.mass", 1.0)), stage)


def test_a_stage_that_would_be_refused_is_not_written(stage: Path) -> None:
    before = stage.read_text()
    for wrong in (("mechanics.inertia", -1.0), ("drive.current_lag", 0.05)):
        with pytest.raises(ConfigError, match="nothing is written"):
            applied(patch_of(naming(wrong), stage))
    assert stage.read_text() == before and [path.name for path in stage.parent.iterdir()] == ["machine.yaml"]


def test_a_file_that_changed_after_the_review_is_left_alone(stage: Path) -> None:
    patch = patch_of(FOUND["effects"], stage)
    stage.write_text(stage.read_text() + "# somebody else\n")
    with pytest.raises(PatchError) as refused:
        applied(patch)
    assert refused.value.place == "source"


def test_backups_are_never_overwritten(stage: Path) -> None:
    first = applied(patch_of(naming(("mechanics.bias", 0.1)), stage))
    second = applied(patch_of(naming(("mechanics.bias", 0.2)), stage))
    assert first is not None and second is not None and first.name != second.name
    assert "bias" not in first.read_text() and "bias: 0.1 N m" in second.read_text()


def run(*words: str) -> tuple[int, str]:
    import typer

    app = typer.Typer()
    app.command("apply")(gap_apply.apply)
    app.callback()(lambda: None)
    result = CliRunner().invoke(app, ["apply", *words])
    if isinstance(result.exception, StageError):
        return 2, str(result.exception)
    return result.exit_code, result.output


def test_the_verb_shows_writes_a_copy_and_does_not_write_unasked(stage: Path, tmp_path: Path) -> None:
    save(FOUND["effects"], tmp_path)
    before, new = stage.read_text(), tmp_path / "new.yaml"
    code, words = run(str(tmp_path), str(stage))
    assert code == 2 and "nobody is there to be asked; --yes writes without asking" in words
    assert run(str(tmp_path), str(stage), "--yes", "-o", str(new))[0] == 0
    assert stage.read_text() == before and load_stage(new).file.mechanics.bias == pytest.approx(0.031)
    code, words = run(str(tmp_path), str(stage), "--yes", "-o", str(new))
    assert code == 2 and "exists: choose another name" in words
    code, words = run(str(tmp_path), str(stage), "--yes", "-o", f"{tmp_path}/sub/")
    assert code == 2 and f"take {tmp_path}/sub.yaml" in words and not (tmp_path / "sub").exists()
    code, words = run(str(tmp_path), str(stage), "--yes", "--json", "-")
    assert code == 0 and '"name": "mechanics.bias"' in words and load_stage(stage).file.mechanics.bias != 0.0
    code, words = run(str(tmp_path), str(stage), "--json", "-")
    assert code == 0 and '"written": null' in words  # all of it stands there already


def test_an_alternative_is_written_in_the_place_of_its_effect(stage: Path) -> None:
    choices = (("backlash", (("mechanics.bias", 0.02),)),)
    result = with_choices(found("effects", effects=(ASYMMETRY, COGGING._replace(choices=choices))), ["backlash"])
    assert [effect.name for effect in result.effects] == [ASYMMETRY.name, "backlash"]
    assert result.effects[1].alternatives == ("cogging", "encoder_eccentricity")
    assert patch_of(result, stage, ["backlash"]).values == {"mechanics.bias": 0.02}


def test_an_alternative_without_values_is_refused_by_name() -> None:
    with pytest.raises(PatchError) as refused:
        with_choices(found("effects", effects=(COGGING,)), ["encoder_eccentricity"])
    assert (refused.value.place, refused.value.value) == ("--choose", "encoder_eccentricity")
