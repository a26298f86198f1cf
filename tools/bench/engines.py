"""The simulator per control period against MuJoCo and scipy's `solve_ivp`, all in one run, interleaved.

What each computes, so that the ratio can be judged::

    ours            law, current loop, inertia, viscous and 12 stop operators, encoder, every recorded column
    MuJoCo          inertia, viscous, one Coulomb friction (`frictionloss`), ideal motor; no law, no current loop
    solve_ivp       current loop, inertia, viscous, 12 smooth operators; no law; right-hand side compiled by numba

MuJoCo and scipy get the commands of our closed loop over a quarter of the 1.6 Hz sine, from a reversal to the
largest speed, and start there as the stage does.  MuJoCo runs without contacts, limits and sensors and with
its fastest solver and integrator for this model.
"""

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import numba
import numpy as np
from measure import Against, Contender, Row, Wanted, interleaved, scaled, times_faster, versus
from scene import Scene, scene, with_substeps
from scipy.integrate import solve_ivp
from simulator import STATED, run

from stagectl.kernels import stage

Run = Callable[[], float]  # returns the position at the end (rad), so that one sees that all move alike
_MODEL = """
<mujoco>
  <option timestep="{step!r}" integrator="Euler" solver="PGS" jacobian="dense" gravity="0 0 0">
    <flag contact="disable" gravity="disable" limit="disable" equality="disable" sensor="disable"/>
  </option>
  <worldbody><body>
    <inertial pos="0 0 0" mass="1" diaginertia="{inertia!r} {inertia!r} {inertia!r}"/>
    <joint name="axis" type="hinge" axis="0 0 1" damping="{viscous!r}" frictionloss="{coulomb!r}"/>
  </body></worldbody>
  <actuator><motor joint="axis" gear="{force_constant!r}"/></actuator>
</mujoco>
"""


class Quarter(NamedTuple):
    """The commands that all engines get, and the state they start from."""

    p: stage.Stage
    dt: float  # s
    commands: Any  # (n,) A
    position: float  # rad, at a positive reversal: velocity 0, all operators slipped forward
    current: float  # A


def quarter(one: Scene) -> Quarter:
    """A quarter of the sine from a reversal on, as the closed loop commanded it."""
    samples = run(one)
    begin = int(np.argmax(samples["true_position"]))
    count = round(0.25 / 1.6 / one.setup.dt)
    commands = np.ascontiguousarray(samples["current"][begin : begin + count])
    place, current = float(samples["true_position"][begin]), float(samples["measured_current"][begin])
    return Quarter(one.setup.stage, one.setup.dt, commands, place, current)


def ours_stepped(q: Quarter, substeps: int) -> Run:
    """Our plant, called from Python once per control period."""

    def call() -> float:
        x = stage.at_rest(q.p, q.position)._replace(current=q.current)
        x.stops[:] = 1.0
        for command in q.commands.tolist():
            x = stage.period(q.p, x, command, stage.SILENT, q.dt, substeps)
        return float(x.position)

    return call


def _mujoco(q: Quarter, substeps: int) -> tuple[Any, Any]:
    import mujoco

    text = _MODEL.format(
        step=q.dt / substeps,
        inertia=q.p.mechanics.inertia,
        viscous=q.p.mechanics.viscous,
        coulomb=float(sum(q.p.friction.operators.weight)),
        force_constant=q.p.motor.force_constant,
    )
    model = mujoco.MjModel.from_xml_string(text)
    return model, mujoco.MjData(model)


def mujoco_stepped(q: Quarter, substeps: int) -> Run:
    """MuJoCo, called from Python once per control period."""
    import mujoco

    model, data = _mujoco(q, substeps)
    commands, control, step = q.commands.tolist(), data.ctrl, mujoco.mj_step

    def call() -> float:
        mujoco.mj_resetData(model, data)
        data.qpos[0] = q.position
        for command in commands:
            control[0] = command
            step(model, data, substeps)
        return float(data.qpos[0])

    return call


def mujoco_rollout(q: Quarter, substeps: int) -> Run:
    """MuJoCo's own rollout module: the whole quarter in C, one thread, states recorded."""
    import mujoco
    from mujoco import rollout

    model, data = _mujoco(q, substeps)
    start = np.zeros(mujoco.mj_stateSize(model, mujoco.mjtState.mjSTATE_FULLPHYSICS))
    start[1] = q.position  # time, position, velocity
    control = np.repeat(q.commands, substeps)[None, :, None].copy()
    engine = rollout.Rollout(nthread=0)

    def call() -> float:
        states, _ = engine.rollout(model, data, start[None], control)
        return float(states[0, -1, 1])

    return call


def _slope(_: float, y: Any, command: float, p: Any) -> Any:
    """d/dt of (position, velocity, current, operators): each operator bends smoothly, ``s' = (v - |v| s)/slip``."""
    weight, slip, inertia, viscous, force_constant, lag = p
    slope = np.empty_like(y)
    force = 0.0
    for j in range(len(weight)):
        s = y[3 + j]
        force += weight[j] * s
        slope[3 + j] = (y[1] - abs(y[1]) * s) / slip[j]
    slope[0] = y[1]
    slope[1] = (force_constant * y[2] - viscous * y[1] - force) / inertia
    slope[2] = (command - y[2]) / lag
    return slope


_compiled: Any = numba.njit(_slope)


def _held_slope(t: float, y: Any, commands: Any, dt: float, p: Any) -> Any:
    return _compiled(t, y, commands[min(int(t / dt), len(commands) - 1)], p)


_compiled_held: Any = numba.njit(_held_slope)


def _for_scipy(q: Quarter) -> tuple[Any, Any]:
    """Parameters and initial state."""
    weight, slip = (np.asarray(values, dtype=np.float64) for values in q.p.friction.operators[:2])
    mechanics = q.p.mechanics
    p = (weight, slip, mechanics.inertia, mechanics.viscous, q.p.motor.force_constant, q.p.drive.current_lag)
    return p, np.array([q.position, 0.0, q.current, *[1.0] * len(weight)])


def scipy_stepped(q: Quarter, method: Any) -> Run:
    """`solve_ivp` once per control period."""
    p, start = _for_scipy(q)

    def call() -> float:
        y = start
        for command in q.commands.tolist():
            y = solve_ivp(_compiled, (0.0, q.dt), y, method=method, rtol=1e-6, args=(command, p)).y[:, -1]
        return float(y[0])

    return call


def scipy_long(q: Quarter, method: Any) -> Run:
    """`solve_ivp` once over the whole quarter, the commands held inside the right-hand side."""
    p, start = _for_scipy(q)
    end, held = q.dt * len(q.commands), (q.commands, q.dt, p)

    def call() -> float:
        solved = solve_ivp(_compiled_held, (0.0, end), start, method=method, rtol=1e-6, args=held)
        return float(solved.y[0, -1])

    return call


_CLOSED, _COARSE = "ours in closed loop", "ours in closed loop, one step a period"
_ALONE = "ours, plant only, called from Python"
_STEPPED, _ROLLOUT = "MuJoCo, mj_step from Python", "MuJoCo, mujoco.rollout"
_STEPPED_COARSE = "MuJoCo, mj_step, one step a period"


def contenders(one: Scene, q: Quarter) -> list[Contender]:
    """All engines, ours in closed loop first."""
    runs: dict[str, Run] = {
        _ALONE: ours_stepped(q, STATED),
        _STEPPED: mujoco_stepped(q, STATED),
        _ROLLOUT: mujoco_rollout(q, STATED),
        _STEPPED_COARSE: mujoco_stepped(q, 1),
        **{f"solve_ivp {m}, per period": scipy_stepped(q, m) for m in ("LSODA", "RK45")},
        **{f"solve_ivp {m}, one long solve": scipy_long(q, m) for m in ("LSODA", "RK45")},
    }
    whole = len(one.plan.setpoints)
    return [
        Contender(_CLOSED, partial(run, one), whole),
        Contender(_COARSE, partial(run, with_substeps(one, 1)), whole),
        *(Contender(name, call, len(q.commands)) for name, call in runs.items()),
    ]


def rows(rounds: int) -> list[Row]:
    """Ratios round by round; then what a period costs each, and how far each moved the axis."""
    one = scene("sine-1.6hz")
    q = quarter(one)
    engines = contenders(one, q)
    found = interleaved(engines, rounds)
    scale = one.setup.file.axis.travel_per_unit
    moved = {engine.name: _moved(engine, q, scale) for engine in engines}
    return [
        _against(_STEPPED, found, 20.0, "20 kHz sub-steps on both sides, the control set once a period"),
        _against(_ROLLOUT, found, 20.0, "open loop in C, one thread, 20 kHz, every sub-step recorded"),
        *(_against(name, found, 100.0, "rtol 1e-6") for name in found if name.startswith("solve_ivp")),
        _shown(
            "MuJoCo / ours, both called from Python", found[_ALONE], found[_STEPPED], "our call is dear from Python"
        ),
        _shown("MuJoCo / ours, one step a period", found[_COARSE], found[_STEPPED_COARSE], "2 kHz steps on both sides"),
        *(_cost(name, seconds, moved[name]) for name, seconds in found.items()),
    ]


def against(rounds: int) -> list[Against]:
    """The same as comparisons with each engine, what it is slower at included."""
    one = scene("sine-1.6hz")
    found = interleaved(contenders(one, quarter(one)), rounds)
    pairs = [
        (_CLOSED, _STEPPED, "whole run; mj_step, 20 kHz"),
        (_CLOSED, _ROLLOUT, "whole run; mujoco.rollout, 20 kHz"),
        (_ALONE, _STEPPED, "plant called from Python; mj_step, 20 kHz"),
        (_COARSE, _STEPPED_COARSE, "whole run; mj_step, 2 kHz"),
        *((_CLOSED, name, f"whole run; {name.removeprefix('solve_ivp ')}") for name in found if "solve_ivp" in name),
    ]
    method = (
        "elapsed time per control period on one thread, interleaved; ours in closed loop with the law where it says "
        "whole run, theirs in open loop under the same commands; scipy's at rtol 1e-6, its right-hand side compiled. "
        "What each computes stands at the top of tools/bench/engines.py"
    )
    return [
        versus(
            ("Simulator", "scipy solve_ivp" if "solve_ivp" in theirs else "MuJoCo", what),
            (found[ours], found[theirs]),
            ("us", 1e6),
            method,
        )
        for ours, theirs, what in pairs
    ]


def _moved(engine: Contender, q: Quarter, scale: float) -> str:
    end = engine.run()
    return f"; travel {1e3 * scale * (end - q.position):.3f} mm" if isinstance(end, float) else ""


def _against(name: str, found: dict[str, list[float]], bound: float, remark: str) -> Row:
    method = f"time per control period over ours in closed loop, compiled; {remark}"
    return Row(f"{name} / ours", times_faster(found[_CLOSED], found[name]), "x", Wanted(bound, True), method)


def _shown(name: str, ours: list[float], theirs: list[float], remark: str) -> Row:
    return Row(name, times_faster(ours, theirs), "x", None, f"for fairness, not judged: {remark}")


def _cost(name: str, seconds: list[float], remark: str) -> Row:
    return Row(f"  a period of {name}", scaled(seconds, 1e6), "us", None, f"elapsed time per control period{remark}")
