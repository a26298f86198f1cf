"""What all benchmarks run: stage A and the paper's motions, from the project's own files."""

from pathlib import Path
from typing import NamedTuple

from stagectl import design
from stagectl.config.stage_file import Setup, load_stage, on_channel
from stagectl.config.trajectory_file import axis_of, load_trajectory
from stagectl.kernels import rollout
from stagectl.plan import Plan, plan
from stagectl.realtime.axes import Post
from stagectl.realtime.shared_memory import Board
from stagectl.recording.ring import Ring
from stagectl.service import single_motion
from stagectl.service.single_motion import Shared

CONFIG = Path(__file__).resolve().parents[2] / "config"
STAGE = CONFIG / "ball-screw.yaml"
FRICTION = frozenset({"friction"})


class Scene(NamedTuple):
    """One motion on one stage, ready to run."""

    setup: Setup
    plan: Plan
    controller: design.Controller

    @property
    def duration(self) -> float:
        """Simulated time (s), with the standstill at the end."""
        return len(self.plan.setpoints) * self.setup.dt


def trajectory(motion: str) -> Path:
    """File of a motion by its name."""
    return CONFIG / "trajectories" / f"{motion}.yaml"


def scene(motion: str, nd: int = 1, without: frozenset[str] = frozenset()) -> Scene:
    """Stage A under `motion`, with `nd` periods between command and action."""
    setup = load_stage(STAGE)
    setup = setup._replace(stage=setup.stage._replace(drive=setup.stage.drive._replace(delay_samples=nd)))
    controller = design.design(setup.stage, setup.file.control).without(without)
    laid_out = plan(setup, load_trajectory(trajectory(motion), axis_of(setup)), controller.feedforward)
    return Scene(setup, laid_out, controller)


def with_substeps(one: Scene, substeps: int) -> Scene:
    """The same, integrated in so many steps per control period."""
    file = one.setup.file._replace(simulation=one.setup.file.simulation._replace(substeps=substeps))
    return one._replace(setup=one.setup._replace(file=file))


def posted(one: Scene, channel: str, shared: Shared) -> Post:
    """The order of the real-time process, on the embedded bus `channel`; no late cycle ends it."""
    setup = on_channel(one.setup, channel)
    return single_motion.posted(single_motion.Motion(setup, one.plan, one.controller.law, {}, Path()), shared)


def shared(one: Scene) -> Shared:
    """Memory that the process of this motion shares with whoever ordered it."""
    return Shared(Ring.create(rollout.WIDTH), Board.create(len(one.plan.setpoints)))
