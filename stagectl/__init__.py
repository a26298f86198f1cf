"""stagectl: real-time control of a precision stage, its simulator, and the gap between the two.

**The tour: the way of one setpoint.**  Open the files in this order.  The first lines of each say what it does.

::

    config/ball-screw.yaml  config/trajectories/sine-1.6hz.yaml
              |                         |
    [1] config/stage_file.py    config/trajectory_file.py           YAML with units, read strictly
              |                         |  trajectories/            position, velocity, acceleration
    [2] design/                         |                           gains, margins, refusal
              |                         |
    [3] plan.py <-----------------------+                           motion_limits.py checked, one row per period
              |
    [4] api/motion.py                   `run` and `simulate`, as Python and the command line call them
        workflows/motion.py             from two YAML files to a result: what they share with `learn`
              |
    [5] service/single_motion.py        starts the loop and the recorder, hands over the rows
              |
    [6] realtime/axes.py                the real-time process: all axes of one bus, 2000 times a second
        realtime/axis.py                one period of one axis:
              |
              |   drives/canopen/drive.py  sample()  -- SYNC -->  drive      the position at t_k is latched,
              |                                      <- TPDO --              the last command begins to act
              |   realtime/setpoint_sources.py    next()    the setpoint that is due
              |   kernels/law.py           step()    feedforward (PTC)  kernels/feedforward.py
              |                                      + feedback         kernels/feedback.py (PID), cascade.py (P-PI)
              |                                      - disturbance      kernels/observer.py
              |                                      + friction         kernels/friction.py, compensation/
              |                                      + learned current  learning.py          -> limit -> current
              |   realtime/safety.py       judge()   may it go on?
              |   drives/canopen/drive.py  apply()   -- RPDO -->  drive      acts from t_k+1 on: nd = 1
              |   recording/ring.py        write()   ==> recording/recorder.py ==> recording.h5
              v
    [7] drives/virtual/node.py          the drive, where there is no machine: a node with kernels/stage.py inside

              command -> drive -> motor -> mechanics <- friction,  encoder -> measured

    [8] kernels/rollout.py              law and stage in one compiled loop: `simulate`; the same rows, to the last bit
        interchange/                    the same stage elsewhere: kernels as C in an FMU, MuJoCo, Isaac Lab: `export`
    [9] evaluation.py, report/run.py    what the motion achieved, in numbers, figures and one page: `report`

**The way of one capture**, from a record of any motion back into the stage file::

    recording.h5, a CSV with units, a .mat, a folder of captures
              |
    [10] recording/imports.py           any log as a recording: guess/ where it does not say what it holds, repair.py
    [11] identification/captures.py     columns in axis units, split at gaps; capture_checks.py: is it plausible?
              |
    [12] identification/methods.py      the method by its name; each has an `identify`
              v
    [13] identification/result.py       parameters with 95 % intervals, and what cannot be distinguished
              |
         config/patch.py                `--write`: the stage file's values change, its comments stay

**The way of one diagnosis**, from logs of a machine to the effects that its model does not contain::

    recordings, a folder of captures, a log
              |
    [14] gap/logs/                      a Session: logs on their periods, nominal model, deployed law
    [15] gap/controller_check/          the command recomputed: did the described controller run?
    [16] gap/residuals/                 unexplained effort and current, sensitivities, Gram matrices
    [17] gap/selection/                 baseline fit, evidence: which effects, with which values
    [18] gap/inference/                 names, intervals, where the gap lies, what stays unknown
    [19] gap/validation/                held-out runs before and after: how far the gap closes
    [20] gap/experiment_design/         the next experiment: the one that separates what is ambiguous
              v
         gap/result/                    the answer as data, JSON, words and patch; report/gap/ draws it

    gap/effects/      one record per effect: all of these rooms read it
    gap/diagnose.py   the pipeline [14] to [20]
    twin/             the model next to the axis while it runs: `run --twin`, `gap watch`, `gap drift`
    tools/studies/    exam, knock-outs and fleets of the diagnosis, both source papers reproduced, foreign machines

**The way of one order**, of a service that runs for months::

    stagectl move ... --> web/client.py --> HTTP, Unix socket --> web/http.py
                                                                     |
    [21] service/orders.py              what each order means        service/service.py  processes, fault list
         service/axis_controller.py     one axis as the service sees it: plans, gains
    [22] realtime/shared_memory.py      orders and setpoints in, status out
    [23] realtime/axes.py, axis.py      the loop of [6]
    [24] realtime/states.py             what each event leads to     stops.py  what each fault leads to
    [25] service/black_box.py           ten seconds before each fault and two after it
         service/stop_path.py           `stagectl stop`: past all of it, straight to [22]
         service/planning.py            a motion laid out, in a process that the service can kill
         web/                           the live page: reads the ring, never the loop

**Signs.**  Positive current gives positive effort and moves towards positive positions.  The error is reference
minus measured.  Friction opposes the velocity: it is positive at positive velocity::

              effort = Kt i  -->  [ J, D ]  -->  + x, + v
              friction       <--

**Units.**  SI inside, names bare.  A rotary axis is in rad and N m, a linear one in m and N, and no kernel knows
which.  A ball screw is a rotary axis with a lead.  Units appear in YAML values, in column names of exports, and on
the screen; `units.Quantity` next to each field declares unit, range and meaning once for all of them.

**Where things are decided.**  What runs, and how strictly: YAML.  Whether it may run: `design` (margin) and `plan`
(limits).  Whether it may go on: `realtime/safety.py`.  Imports run one way only, from `cli` down to `units`; the
contracts are in pyproject.toml and ``tools/check`` enforces them.

**From Python**: the nine functions below, each in `api/`; the command line is made of the same ones.
"""

import sys
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from stagectl.api.comparison import compare
    from stagectl.api.diagnosis import diagnose
    from stagectl.api.identification import identify
    from stagectl.api.motion import run, simulate
    from stagectl.api.record import load_log
    from stagectl.api.stage import load_stage
    from stagectl.api.trajectory import load_trajectory
    from stagectl.api.tuning import tune
    from stagectl.units import StageError

__all__ = [
    "StageError",
    "compare",
    "diagnose",
    "identify",
    "load_log",
    "load_stage",
    "load_trajectory",
    "run",
    "simulate",
    "tune",
]

_MODULES = {  # each imported when its name is first used
    "StageError": "units",
    "compare": "api.comparison",
    "diagnose": "api.diagnosis",
    "identify": "api.identification",
    "load_log": "api.record",
    "load_stage": "api.stage",
    "load_trajectory": "api.trajectory",
    "run": "api.motion",
    "simulate": "api.motion",
    "tune": "api.tuning",
}

if not TYPE_CHECKING:  # a type checker would take any name for one of ours

    def __getattr__(name: str) -> Any:
        """The function of the API with this name, once it is asked for."""
        if name not in _MODULES:
            raise AttributeError(f"module 'stagectl' has no attribute {name!r}", name=name, obj=sys.modules[__name__])
        import importlib

        return getattr(importlib.import_module(f"stagectl.{_MODULES[name]}"), name)

    def __dir__() -> list[str]:
        """What there is, for completion."""
        return sorted({*globals(), *__all__})
