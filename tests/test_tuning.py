"""The search's edge, the rule of the cascade, what is refused, and that a design keeps what it says."""

from __future__ import annotations

import math

import numpy as np
import pytest

from stagectl import design
from stagectl.config.stage_file import Setup, load_stage
from stagectl.kernels import friction, stage
from stagectl.tuning import families
from stagectl.tuning import search as tuning
from stagectl.tuning import sheet as tuned
from tests.conftest import CONFIG, varied


def of(setup: Setup, law: str, own: bool = False) -> families.Family:
    return families.family(setup.stage, setup.file.control, law, own)


def demand(degrees: float, peak: float = math.inf) -> tuning.Demand:
    return tuning.Demand(math.radians(degrees), peak)


def worst(errors: tuning.Tuned) -> tuple[float, float]:
    """Least phase margin of the loops (deg), and Ms of the first."""
    each = list(errors.reached.values())
    return math.degrees(min(margins.phase for margins in each)), each[0].sensitivity.value


EACH = [("ball-screw", "pid"), ("emps", "pid"), ("linear-slider", "cascade")]


@pytest.mark.parametrize(("name", "law"), EACH)
def test_the_fastest_holds_and_nothing_faster_does(name: str, law: str) -> None:
    family = of(load_stage(CONFIG / f"{name}.yaml"), law)
    tuned_loop = tuning.tuned(family, demand(25.0, 2.0))
    degrees, peak = worst(tuned_loop)
    assert degrees >= 25.0
    assert 1.97 < peak <= 2.0  # it is Ms that binds: 2 stands for 29 deg
    assert tuned_loop.binding == (
        f"the sensitivity has a peak of Ms = {_peak(family, 1.01 * tuned_loop.bandwidth):.2f}",
    )
    for share in (1.01, 1.1, 3.0):
        assert tuning.shortfalls(
            families.reached(family.stage, _at(family, share * tuned_loop.bandwidth)), tuned_loop.demand
        )
    assert tuned_loop.bandwidth == float(f"{tuned_loop.bandwidth:.3g}")
    assert tuned_loop.without_peak is not None
    assert tuned_loop.without_peak > 1.05 * tuned_loop.bandwidth
    design.design(family.stage, tuned_loop.control)  # what refuses designs lets it run


def _at(family: families.Family, hertz: float) -> design.Settings:
    return families.chosen(family, hertz)


def _peak(family: families.Family, hertz: float) -> float:
    return next(iter(families.reached(family.stage, _at(family, hertz)).values())).sensitivity.value


@pytest.mark.parametrize("degrees", [35.0])
def test_the_phase_margin_binds_where_ms_is_free(ball_screw: Setup, degrees: float) -> None:
    family = of(ball_screw, "pid")
    tuned_loop = tuning.tuned(family, demand(degrees))
    assert degrees <= worst(tuned_loop)[0] < degrees + 0.5
    assert "phase margin" in tuned_loop.binding[0]
    assert tuned_loop.without_peak is None


def test_forty_hertz_of_stage_a_are_the_papers_gains(ball_screw: Setup) -> None:
    tuned_loop = tuning.tuned(of(ball_screw, "pid"), demand(25.0), 40.0)
    gains = {gain.symbol: gain.value for gain in tuned.gains(ball_screw, tuned_loop.control)}
    assert gains["a"] == pytest.approx(991.31, abs=0.005)
    assert gains["Kp"] == pytest.approx(833.30, abs=0.005)
    assert gains["Ki"] == pytest.approx(55901, abs=0.5)
    assert gains["Kd"] == pytest.approx(4.2749, abs=0.00005)
    assert worst(tuned_loop)[0] == pytest.approx(25.8, abs=0.05)


def test_a_smaller_peak_of_the_sensitivity_is_a_slower_loop(ball_screw: Setup) -> None:
    by_peak = {peak: tuning.tuned(of(ball_screw, "pid"), demand(20.0, peak)) for peak in (1.6, 2.4)}
    for peak, loop in by_peak.items():
        assert 0.98 * peak < worst(loop)[1] <= peak
    assert by_peak[1.6].bandwidth < 0.6 * by_peak[2.4].bandwidth


def nearest_of(error: families.TuningError) -> float:
    """The bandwidth (Hz) that a refusal recommends."""
    assert error.nearest is not None and error.nearest.bandwidth is not None
    return error.nearest.bandwidth


@pytest.mark.parametrize(("law", "hertz", "degrees"), [("pid", 40.0, 30.0), ("cascade", 40.0, 30.0)])
def test_a_refusal_names_the_nearest_that_there_is(ball_screw: Setup, law: str, hertz: float, degrees: float) -> None:
    family = of(ball_screw, law)
    with pytest.raises(families.TuningError) as caught:
        tuning.tuned(family, demand(degrees), hertz)
    nearest = nearest_of(caught.value)
    assert (caught.value.option, caught.value.value) == ("bandwidth", hertz)
    assert f"--bandwidth {nearest:g}Hz" in str(caught.value)
    assert tuning.tuned(family, demand(degrees), nearest).bandwidth == nearest
    assert nearest == tuning.tuned(family, demand(degrees)).bandwidth
    with pytest.raises(families.TuningError):  # and it is not needlessly low
        tuning.tuned(family, demand(degrees), 1.02 * nearest)


def test_too_slow_for_the_damping_is_answered_with_something_faster(ball_screw: Setup) -> None:
    """Below D/(8 pi J) = 0.557 Hz a gain of the placement is negative."""
    family = of(ball_screw, "pid")
    with pytest.raises(families.TuningError) as caught:
        tuning.tuned(family, demand(20.0), 0.5)
    nearest = nearest_of(caught.value)
    assert 0.557 < nearest < 0.8
    tuning.tuned(family, demand(20.0), nearest)


def test_a_margin_that_no_bandwidth_has_is_refused_with_the_most_that_one_has(ball_screw: Setup) -> None:
    family = of(ball_screw, "pid")
    for hertz in (None, 10.0):
        with pytest.raises(families.TuningError) as caught:
            tuning.tuned(family, demand(60.0), hertz)
        assert caught.value.option == ("margin" if hertz is None else "bandwidth")
        nearest = nearest_of(caught.value)
        degrees = caught.value.nearest.margin if caught.value.nearest else None
        assert degrees is not None
        assert 50.0 < degrees < 60.0
        assert worst(tuning.tuned(family, demand(degrees - 0.1), nearest))[0] >= degrees - 0.1


@pytest.mark.parametrize("hertz", [0.0, -1.0, 2001.0, math.inf, math.nan])
def test_a_bandwidth_beyond_what_a_file_takes_is_refused(ball_screw: Setup, hertz: float) -> None:
    with pytest.raises(families.TuningError) as caught:
        tuning.tuned(of(ball_screw, "pid"), demand(20.0), hertz)
    assert (caught.value.option, caught.value.admissible) == ("bandwidth", "(0, 2000]")


def test_the_rule_of_the_cascade(ball_screw: Setup) -> None:
    """fv = 4 f, Ti = 4/(2 pi fv), Tf = 1/(5 2 pi fv), to the four digits that are written."""
    control = families.chosen(of(ball_screw, "cascade"), 10.0)
    assert isinstance(control, design.CascadeControl)
    assert control.position_gain == 62.83
    assert control.velocity_bandwidth == 40.0
    assert control.integral_time == 0.01592
    assert control.force_filter == 0.0007958
    assert control.layers == ("friction", "effects")  # the other law's own default
    assert families.chosen(of(ball_screw, "cascade"), 60.0).force_filter == 0.0  # type: ignore[union-attr]


def test_without_delay_the_rule_gives_the_margin_of_its_three_angles() -> None:
    """90 - atan(1/4) - atan(1/4) - atan(1/5) = 50.6 deg at fv, but for the gain that the zeros add: 4 deg beyond."""
    base = load_stage(CONFIG / "ball-screw.yaml").stage
    p = base._replace(drive=base.drive._replace(delay_samples=0, current_lag=0.0), mechanics=stage.Mechanics(0.01, 0.0))
    family = families.Family(p, design.CascadeControl(2e-5, 1.0, 1.0))
    reached = families.reached(p, families.chosen(family, 2.0))
    w = np.float64(reached["whole loop"].crossover / 8.0)  # over fv
    angle = 90.0 - math.degrees(math.atan(0.25 / w) + math.atan(0.25 / w) + math.atan(w / 5.0))
    assert w == pytest.approx(1.0, abs=0.06)
    assert math.degrees(reached["whole loop"].phase) == pytest.approx(angle, abs=0.2)
    assert math.degrees(reached["velocity loop"].phase) == pytest.approx(64.7, abs=1.0)


def test_own_ratios_are_kept() -> None:
    setup = load_stage(CONFIG / "linear-slider.yaml")
    family = of(setup, "cascade", own=True)
    own = setup.file.control
    assert isinstance(own, design.CascadeControl)
    again = families.chosen(family, own.position_gain / (2.0 * math.pi))
    for name in ("position_gain", "velocity_bandwidth", "integral_time", "force_filter"):
        assert getattr(again, name) == pytest.approx(getattr(own, name), rel=1e-3)
    assert again.layers == own.layers
    half = families.chosen(family, own.position_gain / (4.0 * math.pi))
    assert isinstance(half, design.CascadeControl)
    assert (half.velocity_bandwidth, half.integral_time) == (pytest.approx(60.0), pytest.approx(0.02))
    assert families.ratios_of(own._replace(integral_time=0.0, force_filter=0.0))[1:] == (0.0, 0.0)


def test_a_pid_has_no_ratios(ball_screw: Setup) -> None:
    with pytest.raises(families.TuningError) as caught:
        of(ball_screw, "cascade", own=True)
    assert (caught.value.option, caught.value.value, caught.value.admissible) == ("start", "own", "rule")


def test_with_an_observer_both_loops_keep_the_margin(ball_screw: Setup) -> None:
    control = ball_screw.file.control._replace(layers=("ptc", "observer"))
    family = families.family(ball_screw.stage, control, "pid")
    tuned_loop = tuning.tuned(family, demand(20.0, 2.0))
    assert list(tuned_loop.reached) == ["loop", "without observer"]
    assert tuned_loop.bandwidth < tuning.tuned(of(ball_screw, "pid"), demand(20.0, 2.0)).bandwidth
    design.design(ball_screw.stage, tuned_loop.control)
    assert tuned.step(ball_screw, tuned_loop, 20.0)[-1] == pytest.approx(1.0, abs=1e-3)


@pytest.mark.parametrize(("nd", "nm"), [(0, 0), (2, 1), (4, 2)])
def test_more_delay_is_a_slower_loop(ball_screw: Setup, nd: int, nm: int) -> None:
    """The phase margin at the crossover w falls by w Ts a period: f of the same margin scales with the delay."""
    p = varied(ball_screw, nd=nd, nm=nm).stage
    p = p._replace(friction=p.friction._replace(operators=friction.bundle([], [])))  # which would hold it as a spring
    tuned_loop = tuning.tuned(families.Family(p, design.Control(5e-4, 1.0)), demand(30.0))
    delay = (nd + nm + 0.5) * 5e-4 + p.drive.current_lag
    loop = tuned_loop.reached["loop"]
    lost = delay * 2.0 * math.pi * loop.crossover
    assert 0.15 < lost < 0.5
    assert math.radians(30.0) <= loop.phase < math.radians(30.5)


def test_the_sheet_of_stage_a(ball_screw: Setup) -> None:
    tuned_loop = tuning.tuned(of(ball_screw, "pid"), demand(20.0), 40.0)
    result = tuned.result(ball_screw, tuned_loop)
    loop = result["loops"]["loop"]
    assert loop["gain_margin_down"]["value"] < 1.0 < loop["gain_margin_up"]["value"]
    assert loop["modulus_margin"]["value"] == pytest.approx(1.0 / loop["sensitivity_peak"]["value"])
    assert result["control"] == {"bandwidth": 40.0}
    assert any("13.9 dB" in note for note in result["notes"])
    assert any("2.47" in note for note in result["notes"])
    stiff = result["closed_loop"]["least_stiffness"]
    assert stiff["unit"] == "N/m"
    assert stiff["value"] == pytest.approx(469.78 * (2.0 * math.pi / 12e-3) ** 2, rel=1e-3)
    values = tuned.step(ball_screw, tuned_loop, 20.0)
    assert result["closed_loop"]["overshoot"]["value"] == pytest.approx(float(values.max()) - 1.0)
    settled = round(result["closed_loop"]["settling_time"]["value"] / 5e-4)
    assert np.all(np.abs(values[settled:] - 1.0) <= 0.02)
    assert abs(values[settled - 1] - 1.0) > 0.02


def test_the_other_law_and_back_keeps_what_both_have(ball_screw: Setup) -> None:
    control = ball_screw.file.control._replace(margin=0.3, layers=("ptc",))
    there = families.as_law(control, "cascade")
    assert (there.period, there.margin, there.layers) == (control.period, 0.3, ("ptc",))
    back = families.as_law(there, "pid")
    assert (back.period, back.margin, back.layers) == (control.period, 0.3, ("ptc",))
