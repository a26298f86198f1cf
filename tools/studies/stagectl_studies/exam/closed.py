"""The stratum "closed": `gap close` on a sealed machine that moves only where it is asked to.

::

    draw -> stage.yaml (the user's model) -> seal labels -> gap close -> seal answer -> open -> track -> record
                                                 ^  |
                                          rows   |  v  setpoints          ``blind_closing``, under watch
                                               Session: the machine, and the session's clock

Tracked are the motions on which `gap close` judged itself, run anew when it has ended: with the controller of the
user's model, with that of the last one, and with the oracle's current.  Each error is taken twice: as the encoder shows
it, on which a user judges, and of the true position.  The oracle is the inverse of the machine along the reference: the
current that the machine has learned without noise and rounding, and a target that holds what its encoder adds.  No
feedforward from a model can do better.
"""

import json
import os
import shutil
import threading
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from stagectl.api.stage import DesignedStage
from stagectl.config.stage_file import Setup, load_stage
from stagectl.gap.experiment_design.unseen import judged, unseen
from stagectl.kernels.law import SETPOINT_COLUMNS
from stagectl.plan import Plan, Start, plan
from stagectl_studies.blind_closing import ANSWER, MODEL, RUNS, STAGE
from stagectl_studies.exam.plan import ExamError, Planned
from stagectl_studies.exam.question import CAPTURES, SCRATCH, Manner, Place, asked
from stagectl_studies.exam.staging import drawn, packed, unpacked
from stagectl_studies.foreign.axis import Axis
from stagectl_studies.foreign.trial import learn
from stagectl_studies.machine.controller import Model
from stagectl_studies.machine.drive import encoder_error
from stagectl_studies.machine.machine import Encoder, Machine
from stagectl_studies.machine.plant import ideal
from stagectl_studies.machine.trials import Trial
from stagectl_studies.reproduction.bench import CONFIG

MODULE = "stagectl_studies.blind_closing"
BEFORE, AFTER, ORACLE = "before", "after", "oracle"
REPEATS = 3  # of each motion, with the same noise for all controllers: so are compared what they do
_LOOK = 0.002  # s between two looks for a run that is asked for
_APART = 1_000_000  # numbers from the runs of the session to those after it

Record = dict[str, Any]


class Session:
    """The machine of a trial while it is closed; its noise and its clock go on from run to run."""

    def __init__(self, axis: Axis) -> None:
        """At the beginning of the session."""
        self.axis, self.runs, self.clock = axis, 0, axis.start
        self.error: Exception | None = None  # of ours, not of the machine

    def run(self, setup: Setup, setpoints: NDArray[np.float64], start: float) -> NDArray[Any]:
        """Rows (n,), without the true position; it begins at `start` or when the last run has ended.

        Raises ValueError where the axis is lost.
        """
        begin = max(start, self.clock)
        self.runs += 1
        self.clock = begin + len(setpoints) * setup.dt
        rows = self.axis._replace(start=begin).run(setup, Plan(setpoints, (0.0, 0.0), 0.0), self.runs)
        rows["true_position"] = np.nan
        return rows

    @contextmanager
    def answering(self, stage: Path, runs: Path) -> Iterator[None]:
        """Carry out what is asked for in the folder `runs`; an axis that is lost is answered with no rows."""
        ended = threading.Event()
        server = threading.Thread(target=self._serve, args=(stage, runs, ended), daemon=True)
        server.start()
        try:
            yield
        finally:
            ended.set()
            server.join()
        if self.error is not None:
            raise self.error

    def _serve(self, stage: Path, runs: Path, ended: threading.Event) -> None:
        while not ended.wait(_LOOK):
            request = runs / f"{self.runs + 1}.npz"
            if request.exists():
                rows = self._answer(stage, request)
                draft = request.with_suffix(".draft.npy")
                np.save(draft, rows)
                os.replace(draft, request.with_suffix(".npy"))

    def _answer(self, stage: Path, request: Path) -> NDArray[Any]:
        try:
            with np.load(request) as told:
                setup = load_stage(stage, text=str(told["stage"]))
                return self.run(setup, told["setpoints"], float(told["start"]))
        except ValueError:
            self.runs = int(request.stem)
        except Exception as error:  # whoever asked must not wait for ever: the trial ends with it
            self.error, self.runs = error, int(request.stem)
        return np.empty(0)


def staged(planned: Planned, folder: Path, short: bool) -> bytes:
    """Write the user's stage file into `folder`/captures; the labels.

    Raises ExamError where no loop bears the machine, or it is to be on the ground of a record.
    """
    if planned.ground is not None:
        raise ExamError(f"the stratum {planned.stratum} has stage files of its own: leave --on out")
    trial, machine = sealed(planned, short)
    there = folder / CAPTURES
    there.mkdir()
    shutil.copytree(CONFIG / "drives", there / "drives")
    (there / STAGE).write_text(stage_text(trial.model), encoding="utf-8")
    effects = {effect.name: effect.realised for effect in trial.hidden}
    truth = {"seed": trial.seed, "law": trial.law, "effects": effects, "machine": repr(machine)}
    return packed({**truth, "stratum": planned.stratum}, {})


def sealed(planned: Planned, short: bool) -> tuple[Trial, Machine]:
    """The trial, and its machine behind the bus of the ball screw's stage file, which rounds the commands."""
    trial = drawn(planned, short)
    machine, bus = trial.rig.machine, load_stage(CONFIG / "ball-screw.yaml").stage.drive
    return trial, machine._replace(drive=machine.drive._replace(quantum=machine.drive.quantum or bus.current_quantum))


def stage_text(model: Model) -> str:
    """The stage file of the ball screw, with what the user believes of this machine, and its encoder's data sheet."""
    friction = {"law": "stop-operators", "weight": model.weight.tolist(), "slip": model.slip.tolist()}
    changes = {"mechanics.inertia": model.inertia, "mechanics.viscous": model.viscous, "friction": friction}
    changes["encoder.interpolation.order"] = Encoder().periods  # as `nominal.yaml` has it in the other strata
    return DesignedStage(load_stage(CONFIG / "ball-screw.yaml")).changed(changes).text


class Closed(NamedTuple):
    """What `gap close` has left."""

    session: Session
    failure: str  # why there is no answer, empty where there is


def closed(place: Place, planned: Planned, manner: Manner) -> Closed:
    """Close the gap of the machine, from the stage file alone."""
    axis = Axis(sealed(planned, manner.short)[1], planned.seed)
    folder, session = place.folder, Session(axis)
    words = [str(folder / CAPTURES), str(folder / place.out), *(["--short"] if manner.short else [])]
    with session.answering(folder / CAPTURES / STAGE, folder / SCRATCH / RUNS):
        module = MODULE if manner.module == Manner().module else manner.module
        return Closed(session, asked(place, module, words, manner))


def record(labels: bytes, place: Place, what: Closed) -> Record:
    """The record's content: how the machine tracks, what was foretold; without an answer nothing has been closed."""
    truth, _ = unpacked(labels)
    folder, answer = place.folder, place.folder / place.out
    stage = folder / CAPTURES / STAGE
    said: Mapping[str, Any] = {} if what.failure else json.loads((answer / ANSWER).read_text(encoding="utf-8"))
    before = load_stage(stage)
    after = load_stage(stage, text=(answer / MODEL).read_text(encoding="utf-8")) if said else before
    axis = what.session.axis._replace(start=what.session.clock)
    rms, true = levels(axis, before, after)
    return {
        **{name: truth[name] for name in ("stratum", "seed")},
        "truth": {"effects": truth["effects"], "hidden": list(truth["effects"]), "law": truth["law"]},
        "answer": {
            "named": [name for found in said.get("rounds", []) for name in found["found"]],
            "ended": said.get("ended", ""),
        },
        "closing": {
            "rms": rms,
            "true": true,
            "realised": closure(rms),
            "stated": closure(said.get("levels")),
            "foretold": closure(said.get("foretold")),
        },
    }


def closure(rms: Mapping[str, float] | None) -> float | None:
    """Share of the squared error that went; None where nothing was closed."""
    return 1.0 - (rms[AFTER] / rms[BEFORE]) ** 2 if rms else None


def levels(axis: Axis, before: Setup, after: Setup) -> tuple[dict[str, float], ...]:
    """Tracking error (m rms) with each controller and the oracle, as measured and true.

    The geometric mean over the motions.
    """
    each: dict[str, list[NDArray[np.float64]]] = {BEFORE: [], AFTER: [], ORACLE: []}
    for number, motion in enumerate(unseen(before)):
        setups = {BEFORE: before, AFTER: after}
        plans = {name: (setup, planned_by(setup, motion, axis.start)) for name, setup in setups.items()}
        plans[ORACLE] = (before, oracle(axis, before, plans[BEFORE][1]))
        for name, (setup, laid_out) in plans.items():
            first = _APART + number * REPEATS
            each[name].append(np.mean([squares(axis, setup, laid_out, first + k) for k in range(REPEATS)], axis=0))
    means = {name: np.exp(0.5 * np.mean(np.log(values), axis=0)) for name, values in each.items()}
    return tuple({name: float(pair[k]) for name, pair in means.items()} for k in range(2))


def planned_by(setup: Setup, motion: Any, clock: float) -> Plan:
    """The motion as this set-up lays it out for the session's `clock` (s), with the window in which it is judged."""
    laid_out = plan(setup, motion.trajectory, setup.controller.feedforward, Start(clock=clock))
    return laid_out._replace(steady=judged(motion))


def oracle(axis: Axis, setup: Setup, base: Plan) -> Plan:
    """`base` with the current that the machine needs along the reference, its target with what the encoder adds."""
    quiet = ideal(axis.machine)
    laid_out = learn(axis._replace(machine=quiet._replace(encoder=Encoder(step=0.0, noise=0.0))), setup, base, 0)
    rows = laid_out.setpoints.copy()
    target, reference = (SETPOINT_COLUMNS[name] for name in ("target", "reference"))
    rows[:, target] += [encoder_error(axis.machine.encoder, x) for x in rows[:, reference].tolist()]
    return laid_out._replace(setpoints=rows, mapped=True)


def squares(axis: Axis, setup: Setup, laid_out: Plan, number: int) -> NDArray[np.float64]:
    """Mean squares of the tracking error in the steady window, as measured and true, (2,) m^2."""
    rows = axis.run(setup, laid_out, number)
    inside = (rows["time"] >= laid_out.steady[0]) & (rows["time"] < laid_out.steady[1])
    should = rows["target" if laid_out.mapped else "reference"]  # as `evaluation.tracking_error` has it
    errors = np.stack([should - rows["measured"], rows["reference"] - rows["true_position"]])[:, inside]
    mean: NDArray[np.float64] = np.mean((errors * setup.file.axis.travel_per_unit) ** 2, axis=1)
    return mean
