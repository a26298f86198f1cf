"""The next experiment: it separates what three sines do not, and says so where no motion can."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from stagectl import design
from stagectl.config.stage_file import Setup, load_stage
from stagectl.config.trajectory_file import axis_of, load_trajectory
from stagectl.gap.effects import stage_changes
from stagectl.gap.experiment_design import (
    catalogue,
    coverage,
    experiment_proposal,
    nuisance_refit,
    operating_range,
    prediction_distance,
)
from stagectl.gap.experiment_design.experiment import made
from stagectl.gap.logs.load_session import load
from stagectl.gap.logs.log_start import LogStart
from stagectl.gap.logs.session import GapError, Session
from stagectl.gap.residuals.half_strokes import kept, standstills
from stagectl.gap.result.diagnosis import NextExperiment
from stagectl.gap.validation.rollouts import Rollout
from stagectl.kernels.stage import Stage
from stagectl.plan import plan
from stagectl.simulation import simulate
from stagectl.workflows.motion import prepare
from stagectl.workflows.simulated_motion import pretend
from tests.gap.captured import CONFIG, exported

NOISE = ("  substeps: 10 ", "  current_noise: 50 mA\n  encoder_noise: 20 nm\n  substeps: 10 ")
SINES = ((10.0, 0.8), (5.0, 1.6), (2.5, 3.2))  # mm, Hz: all of one peak speed, 50 mm/s
NAN = math.nan

Columns = NDArray[np.float64]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two recordings of each of three sines on stage A, with noise."""
    place = tmp_path_factory.mktemp("poor")
    text = (CONFIG / "ball-screw.yaml").read_text()
    assert text.count(NOISE[0]) == 1
    (place / "stage.yaml").write_text(text.replace(*NOISE))
    setup = load_stage(place / "stage.yaml")
    for number, (amplitude, frequency) in enumerate(SINES):
        motion = place / f"sine-{frequency}.yaml"
        motion.write_text(f"type: sine\namplitude: {amplitude} mm\nfrequency: {frequency} Hz\nperiods: 2\nramp: 0.5\n")
        for repeat in (1, 2):
            simulation = setup.file.simulation._replace(seed=10 * number + repeat)
            seeded = setup.having(simulation=simulation)
            pretend(prepare(seeded, motion, frozenset(), place / f"sine-{frequency}-{repeat}.h5"))
    return place


@pytest.fixture(scope="module")
def session(folder: Path) -> Session:
    return load([folder])


def backlash(p: Stage, gap: float) -> Stage:
    changed = p.mechanics.transmission._replace(
        backlash=gap, load_share=0.3, load_friction=0.9, resonance=800.0, damping=0.1
    )
    return stage_changes.put(p, "mechanics.transmission", changed)


def rivals(p: Stage) -> dict[str, Stage]:
    """A gap of 0.17 um, or a rolling zone that is longer by about as much."""
    return {"backlash": backlash(p, 9e-5), "presliding": stage_changes.stretched(p, {"size": 0.03})}


def distance(session: Session, models: dict[str, Stage]) -> float:
    """What the session's own logs separate two models by (sigma), the nuisances taken as linear."""
    p, noise = operating_range.operating_range(session), prediction_distance.noise_of(session, NAN)
    first, second = (nuisance_refit.spread(model) for model in models.values())
    runs = [
        prediction_distance.PlannedRun(
            Rollout(log.setpoints, p.law, LogStart(0.0, 0.0), session.dt),
            noise,
            True,
            kept(standstills(log.setpoints[:, 0], session.dt)),
        )
        for log in session.logs[::2]  # one repeat of each
        if log.setpoints is not None
    ]
    tangents = [nuisance_refit.linearised(planned, second, nuisance_refit.nuisances(second, True)) for planned in runs]
    truth = np.concatenate([prediction_distance.predict(planned, first).values for planned in runs])
    value = np.concatenate([tangent.value for tangent in tangents])
    slopes = np.concatenate([tangent.slopes for tangent in tangents], axis=1)
    return nuisance_refit.linear_distance(value, slopes, truth)


def run(setup: Setup, proposed: NextExperiment, model: Stage, place: Path, seed: int | None = None) -> Columns:
    """(n, 2) position and current as `run` would record them from `model`; quiet without a seed."""
    path = place / proposed.trajectory
    path.write_text(proposed.text)
    controller = design.design(setup.stage, setup.file.control)
    laid_out = plan(setup, load_trajectory(path, axis_of(setup)), controller.feedforward)
    noise = {"current_noise": 0.0, "encoder_noise": 0.0} if seed is None else {"seed": seed}
    file = setup.file._replace(simulation=setup.file.simulation._replace(**noise))
    rows = simulate(setup, laid_out, controller.law, setup._replace(stage=model, file=file))
    return np.stack([rows["measured"], rows["measured_current"]], axis=1)


@pytest.fixture(scope="module")
def proposed(session: Session) -> NextExperiment:
    proposal = experiment_proposal.propose(session, rivals(session.stage), NAN)
    assert proposal is not None
    return proposal


def test_the_poor_battery_does_not_tell_and_the_proposed_experiment_does(
    session: Session, proposed: NextExperiment
) -> None:
    poor = distance(session, rivals(session.stage))
    assert proposed.separates == ("backlash", "presliding")
    assert proposed.name.startswith("micro") and proposed.duration < 30.0
    assert poor < 10.0 < 3.0 * poor < proposed.separation_sigma


@pytest.mark.parametrize("hidden", ["backlash", "presliding"])
def test_what_three_sines_leave_open_is_told(
    session: Session, proposed: NextExperiment, folder: Path, tmp_path: Path, hidden: str
) -> None:
    """Micro-sines on the true machine: the right model leaves the noise alone, the other 10 sigma at least."""
    models = rivals(session.stage)
    setup = load_stage(folder / "stage.yaml")
    repeats = [run(setup, proposed, models[hidden], tmp_path, seed) for seed in (101, 102)]
    sigma = np.std(repeats[0] - repeats[1], axis=0) / math.sqrt(2.0)
    left = {
        name: np.sum(((repeats[0] - run(setup, proposed, model, tmp_path)) / sigma) ** 2)
        for name, model in models.items()
    }
    assert 0.9 < left[hidden] / repeats[0].size < 1.2  # a quiet gap closes a little earlier than a noisy one
    (other,) = set(models) - {hidden}
    assert math.sqrt(left[other] - left[hidden]) > 10.0


def test_an_exact_symmetry_goes_to_the_hand(session: Session) -> None:
    """A stronger motor, or inertia, damping and friction that are all smaller: no motion tells."""
    p = session.stage
    models = {
        "force_constant": stage_changes.put(p, "motor.force_constant", 1.05 * p.motor.force_constant),
        "inertia": stage_changes.put(p, "mechanics.inertia", p.mechanics.inertia / 1.05),
    }
    proposed = experiment_proposal.propose(session, models, NAN)
    assert proposed is not None
    assert (proposed.name, proposed.trajectory, proposed.text) == ("added mass", "", "")
    assert proposed.separates == ("force_constant", "inertia")
    assert "by hand" in proposed.words and "Weigh a mass" in proposed.words


def test_within_what_the_logs_have_shown(
    session: Session, proposed: NextExperiment, folder: Path, tmp_path: Path
) -> None:
    """Travel, speed and current stay within those of the sines, or the words say by how much they do not."""
    reach = operating_range.operating_range(session)
    per_unit = session.travel_per_unit
    assert reach.known and reach.start == 0.0
    assert reach.seen.speed * per_unit == pytest.approx(2 * math.pi * 0.8 * 0.01, rel=0.01)
    assert (reach.scale.low, reach.scale.high) == pytest.approx((-0.01, 0.01), rel=0.01)
    assert reach.cautions() == []
    setup = load_stage(folder / "stage.yaml")
    path = tmp_path / "next.yaml"
    path.write_text(proposed.text)
    feedforward = design.design(setup.stage, setup.file.control).feedforward
    rows = plan(setup, load_trajectory(path, axis_of(setup)), feedforward)
    reference = rows.setpoints[:, 0]
    assert np.ptp(reference) <= 1.01 * (reach.seen.high - reach.seen.low)
    assert np.abs(np.diff(reference)).max() / session.dt < 1.1 * reach.seen.speed
    assert "beyond" not in proposed.words and "farther" not in proposed.words


def test_what_goes_beyond_is_said_and_comes_last(session: Session) -> None:
    """A faster experiment is no finalist beside one that is clear; alone it is, and its words say how fast."""
    p = operating_range.operating_range(session)
    by_name = {experiment.name: experiment for experiment in made(p.scale, catalogue.RECIPES)}
    still = Rollout(np.zeros((2, 8)), p.law, LogStart(0.0, 0.0), session.dt)
    planned = prediction_distance.PlannedRun(still, prediction_distance.noise_of(session, NAN), True)
    fast = experiment_proposal.SimulatedExperiment(
        by_name["fast-cruise"], planned, 500.0, 1.3 * p.seen.current, 1.5 * p.seen.speed
    )
    slow = experiment_proposal.SimulatedExperiment(by_name["strokes"], planned, 20.0, p.seen.current, p.seen.speed)
    assert experiment_proposal.finalists([fast, slow], p) == [slow]
    assert experiment_proposal.finalists([fast, slow._replace(separation=9.0)], p)[0] == fast
    speed, current = experiment_proposal.exceeding(fast, p)
    assert speed == "0.0754 m/s (the logs: 0.0503)" and current.endswith(f"A (the logs: {p.seen.current:.3g})")
    assert experiment_proposal.exceeding(slow, p) == []


def test_the_promising_bear_on_what_is_to_be_told(session: Session) -> None:
    """Those that bear on both come first, none is longer than a minute, all together are affordable."""
    known = made(operating_range.operating_range(session).scale, catalogue.RECIPES)
    proposal = experiment_proposal.promising(known, ("viscous_nonlinear", "stribeck"))
    shared = [len({"viscous_nonlinear", "stribeck"} & set(experiment.effects)) for experiment in proposal]
    assert shared[0] == 2 and shared == sorted(shared, reverse=True) and shared[-1] >= 1
    assert (
        max(experiment.duration for experiment in proposal) <= 60.0
        and sum(experiment.duration for experiment in proposal) <= 90.0
    )


def test_setpoints_are_those_of_the_daemon(session: Session, ball_screw: Setup) -> None:
    """From the description of the controller as from the stage file, to a part in a thousand of the current."""
    p = operating_range.operating_range(session)
    experiment = next(
        experiment for experiment in made(p.scale, catalogue.RECIPES) if experiment.name == "swing-one-way"
    )
    ours, theirs = operating_range.setpoints_for(session, p, experiment), experiment.setpoints(ball_screw)
    assert len(ours) == len(theirs)
    np.testing.assert_allclose(ours[:, 0], theirs[:, 0], atol=1e-9)
    assert np.percentile(np.abs(ours[:, 2] - theirs[:, 2]), 99) < 1e-3 * np.abs(theirs[:, 2]).max()


def test_a_folder_from_elsewhere_and_one_without_a_controller(folder: Path, tmp_path: Path, session: Session) -> None:
    """The same room from captures; a loop of our own design stands in for one that is not known, and it is said."""
    place = exported([folder / "sine-1.6-1.h5", folder / "sine-1.6-2.h5"], tmp_path / "captures", False)
    other = load([place])
    assert operating_range.operating_range(other).known
    blind = other._replace(law=None, nominal={k: v for k, v in other.nominal.items() if k != "controller"})
    reach = operating_range.operating_range(blind)
    assert not reach.known
    assert "The deployed controller is not known" in reach.cautions()[-1]
    planned = experiment_proposal.planned_run(
        blind, reach, prediction_distance.noise_of(blind, NAN), made(reach.scale, catalogue.RECIPES)[0]
    )
    values = prediction_distance.predict(planned, blind.stage)
    assert np.isfinite(values.values).all() and values.current < 1.1 * reach.scale.current_limit


def test_noise_of_the_repeats_and_without_them(session: Session) -> None:
    """White noise of the encoder, 20 nm, beyond the loop's bandwidth: 2 dt sigma^2.  One repeat: the floor."""
    noise = prediction_distance.noise_of(session, NAN)
    sigma = 20e-9 / session.travel_per_unit
    high = noise.frequency > 700.0
    assert np.median(noise.position[high]) == pytest.approx(2.0 * session.dt * sigma * sigma, rel=0.3)
    single = session._replace(logs=session.logs[:1])
    assert prediction_distance.noise_of(single, 1e-5).position[-1] == pytest.approx(2.0 * session.dt * 1e-10, rel=1e-9)


def test_whitened_white_noise_has_a_variance_of_one(session: Session) -> None:
    random = np.random.default_rng(3)
    flat = prediction_distance.RepeatNoise(np.array([0.0, 1000.0]), np.full(2, 2.0 * session.dt * 4.0), np.ones(2))
    law = operating_range.operating_range(session).law
    planned = prediction_distance.PlannedRun(
        Rollout(np.zeros((20000, 8)), law, LogStart(0.0, 0.0), session.dt), flat, True
    )
    signal = 2.0 * random.standard_normal(20000)
    density = prediction_distance._whitened(planned, signal, flat.position, 0.0)
    frequency = np.fft.rfftfreq(20000, session.dt)
    share = np.sum((frequency <= 400.0) / (1.0 + (frequency / 40.0) ** 2)) / len(frequency)
    assert np.sum(density * density) == pytest.approx(20000 * share, rel=0.05)


def test_what_the_sines_never_showed(session: Session) -> None:
    """No held speeds, no dwells, no stroke within presliding, no injection; the stairs come first."""
    words = [words for words, _ in coverage.uncovered(session)]
    assert len(words) == 4
    assert "speed" in words[0] and "fewer than 5" in words[0]
    assert "standstills" in words[1] and "within presliding" in words[2] and "injected" in words[3]
    proposed = experiment_proposal.propose(session, {}, NAN)
    assert proposed is not None
    assert (proposed.name, proposed.separates, proposed.separation_sigma) == ("stairs", (), 0.0)
    assert proposed.words.startswith(words[0][0].upper() + words[0][1:])
    assert proposed.text.startswith("# stairs, ")


def test_what_is_covered_is_not_asked_for(session: Session, ball_screw: Setup) -> None:
    """The references of the whole battery leave nothing open; one way of it alone leaves bias open."""
    from stagectl.gap.experiment_design.battery import battery

    logs = []
    for experiment in battery(ball_screw):
        rows = experiment.setpoints(ball_screw)
        logs.append(
            session.logs[0]._replace(
                name=experiment.name, position=rows[:, 0], reference=rows[:, 0], injection=rows[:, 6]
            )
        )
    assert coverage.uncovered(session._replace(logs=tuple(logs))) == []
    assert experiment_proposal.propose(session._replace(logs=tuple(logs)), {"viscous": session.stage}, NAN) is None
    up = [log._replace(reference=np.cumsum(np.maximum(np.diff(log.position, prepend=0.0), 0.0))) for log in logs]
    assert "one direction only" in coverage.uncovered(session._replace(logs=tuple(up)))[0][0]


def test_logs_that_never_move_are_refused(session: Session) -> None:
    still = [log._replace(position=0.0 * log.position, reference=0.0 * log.position) for log in session.logs]
    with pytest.raises(GapError, match="moves"):
        experiment_proposal.propose(session._replace(logs=tuple(still)), {}, NAN)


def test_a_one_sided_record_starts_in_the_middle(session: Session) -> None:
    """Logs that go up from where they begin leave no room downwards; the middle does, and the words say so."""
    up = [log._replace(position=log.position + 5.236, reference=log.position + 5.236) for log in session.logs]
    begins = [log._replace(reference=np.concatenate([[0.0], log.position[1:]])) for log in up]
    reach = operating_range.operating_range(session._replace(logs=tuple(begins)))
    assert reach.start == pytest.approx(5.236, rel=1e-3)
    assert reach.cautions()[0].startswith("Start in the middle of the travel, at 10")


def test_a_gentle_record_asks_to_see_that_the_machine_may(session: Session) -> None:
    """Stairs need more current than logs that crept: the words say how much."""
    gentle = [
        log._replace(command=0.01 * log.command, current=0.01 * log.current)
        for log in session.logs
        if log.command is not None and log.current is not None
    ]
    proposal = experiment_proposal.propose(session._replace(logs=tuple(gentle)), {}, NAN)
    assert proposal is not None and proposal.name == "stairs"
    assert "It goes beyond what the logs have shown, to " in proposal.words and " A (the logs: 0.1" in proposal.words
