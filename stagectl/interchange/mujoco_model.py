"""The plant as a MuJoCo model (MJCF): a joint, a current-controlled drive, and passive friction and cogging.

::

    ctrl (A) --> delay --> limit --> lag --> Kt ----+--> joint (inertia, viscous) --> sensor, late by nm Ts
                                       bias --------+
        dcmotor without input: one LuGre bristle ---+   as many as the friction needs
        dcmotor without input: cogging -------------+

Stop operators become bristles that only resemble them; `passive_force` beside the model gives them exactly.  A relaxed
bundle resists a move x with ``F(x) = sum w_j min(x/s_j, 1)``; bristles of limits c_i and slips r_i do with ``sum c_i
(1 - exp(-x/r_i))``.  The c_i >= 0 on a ladder of slips are fitted to F, with the same force at speed.

The control is the current that the law commands, in A; positions are in the axis' own unit (rad | m).
Source of the elements: MuJoCo's XML reference, `actuator/general` and `actuator/dcmotor`, version 4.0.
"""

import importlib.util
import math
import re
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import mujoco
import numpy as np

from stagectl.config.stage_file import Setup
from stagectl.interchange.export import ExportedModel, lost, write_texts
from stagectl.interchange.round_trip import Array, Simulated, compared
from stagectl.kernels import stage
from stagectl.kernels.effects import TURN, Harmonic
from stagectl.kernels.friction import StopOperators, Stribeck
from stagectl.kernels.friction_bristle import Bristle
from stagectl.kernels.plant import Friction, Stage
from stagectl.units import LINEAR

AXIS = "axis"  # name of body, joint and actuator
CURVE_POINTS = 400  # of the friction's curve to which bristles are fitted; ten times as many change no limit by 1 %
CURVE_REACH = 5.0  # speeds of a Stribeck curve to which another shape is fitted, over its own speed
LADDER = 12  # slips that bristles may have; those of no use get no share
LADDER_REACH = 3.0  # shortest of them under the shortest slip of an operator
LAG_STEPS = 4  # steps of the other simulator within the lag of the current loop, at least
GAUSSIAN = 2.0  # the shape of the Stribeck curve that `lugre` has
FITTED = 1  # actuator group of the bristles that stand for stop operators

# Entries of the plant that the model holds; whatever else is not neutral is reported as lost.
HELD = {
    "drive": {"delay_samples", "dead_time", "current_limit", "current_lag"},
    "motor": {"force_constant", "cogging", "cogging_second"},
    "mechanics": {"inertia", "viscous", "bias", "pitch"},
    "friction": {"operators", "stribeck", "bristle"},
    "encoder": {"delay_samples"},
}


def model(setup: Setup) -> str:
    """The text of the MJCF file."""
    p, time = setup.stage, step(setup)
    root = ElementTree.Element("mujoco", model=setup.file.name)
    option = _child(root, "option", timestep=time, gravity="0 0 0", integrator="implicitfast")
    _child(option, "flag", contact="disable")
    if operators(p):
        _child(root, "size", nuserdata=len(p.friction.operators.weight) + 2)
    linear = setup.file.axis.kind == LINEAR
    body = _child(_child(root, "worldbody"), "body", name=AXIS)
    _child(body, "joint", name=AXIS, type="slide" if linear else "hinge", axis="1 0 0", damping=p.mechanics.viscous)
    inertia = p.mechanics.inertia
    _child(body, "inertial", pos="0 0 0", mass=inertia, diaginertia=f"{inertia!r} {inertia!r} {inertia!r}")
    actuators = _child(root, "actuator")
    _drive(actuators, setup)
    each = bristles(p.friction)
    for number, bristle in enumerate(each):
        fitted = bristle is not p.friction.bristle
        _passive(actuators, f"friction{number}", lugre=_lugre(bristle), group=FITTED if fitted else 0)
    for name in ("cogging", "cogging_second"):
        wave: Harmonic = getattr(p.motor, name)
        if wave.amplitude:
            order = wave.order * TURN / p.mechanics.pitch  # periods a radian of MuJoCo's angle: the position itself
            _passive(actuators, name, cogging=f"{wave.amplitude!r} {order!r} {wave.phase!r}")
    late = _delayed(p.encoder.delay_samples * setup.dt, time)
    _child(_child(root, "sensor"), "jointpos", name="measured", joint=AXIS, **late)
    _rest(root, p, each)
    ElementTree.indent(root)
    return ElementTree.tostring(root, encoding="unicode") + "\n"


def operators(p: Stage) -> bool:
    """Whether stop operators act, which the XML file alone cannot hold."""
    return bool(sum(p.friction.operators.weight) > 0.0)


def callback(p: Stage) -> str:
    """The text of the Python file that gives the stop operators exactly."""
    text, friction = (Path(__file__).parent / "passive_force.py").read_text(encoding="utf-8"), p.friction
    values = {
        "WEIGHT": [float(x) for x in friction.operators.weight],
        "SLIP": [float(x) for x in friction.operators.slip],
        "START": [float(x) for x in stage.at_rest(p).stops],
        "STRIBECK": tuple(friction.stribeck),
    }
    for name, value in values.items():  # their comments stay
        text = re.sub(rf"^{name}\b.*?(?=  #)", f"{name} = {value}", text, flags=re.MULTILINE)
    return text


def step(setup: Setup) -> float:
    """Time step (s): a whole part of the control period, as short as that of ours, and within the current's lag."""
    lag = setup.stage.drive.current_lag
    parts = max(setup.file.simulation.substeps, math.ceil(LAG_STEPS * setup.dt / lag) if lag else 1)
    return setup.dt / parts


def _drive(actuators: ElementTree.Element, setup: Setup) -> None:
    """The current of the drive and its effort, with the constant effort on the axis."""
    p = setup.stage
    options = _delayed(p.drive.delay_samples * setup.dt + p.drive.dead_time, step(setup))
    if p.drive.current_lag:
        options |= {"dyntype": "filterexact", "dynprm": p.drive.current_lag}
    limit = p.drive.current_limit
    if math.isfinite(limit):
        options |= {"ctrllimited": "true", "ctrlrange": f"{-limit!r} {limit!r}"}
    bias = {"biastype": "affine", "biasprm": f"{p.mechanics.bias!r} 0 0"}
    _child(actuators, "general", name=AXIS, joint=AXIS, gainprm=p.motor.force_constant, **bias, **options)


def _rest(root: ElementTree.Element, p: Stage, each: list[Bristle]) -> None:
    """Where it stands by itself: every bristle carries its share of the constant effort."""
    whole = sum(bristle.coulomb for bristle in each) or 1.0
    deflections = [p.mechanics.bias * bristle.coulomb / whole / bristle.stiffness for bristle in each]
    states = [0.0, *deflections] if p.drive.current_lag else deflections
    _child(_child(root, "keyframe"), "key", name="rest", act=" ".join(map(repr, states)))


def _delayed(late: float, time: float) -> dict[str, object]:
    """A delay (s), less half a time step: rounding of the clock must not choose between two samples."""
    return {"nsample": round(late / time) + 1, "delay": late - 0.5 * time} if late else {}


def _passive(actuators: ElementTree.Element, name: str, **effect: object) -> None:
    _child(actuators, "dcmotor", name=name, joint=AXIS, input="none", motorconst="0 0", resistance=1.0, **effect)


def _lugre(p: Bristle) -> str:
    curve = gaussian(p.stribeck)
    static = p.coulomb * (1.0 + curve.rise)
    return " ".join(map(repr, (p.stiffness, p.damping, p.coulomb, static, curve.velocity)))


def _child(parent: ElementTree.Element, tag: str, /, **entries: object) -> ElementTree.Element:
    words = {key: repr(value) if isinstance(value, float) else str(value) for key, value in entries.items()}
    return ElementTree.SubElement(parent, tag, words)


def bristles(p: Friction) -> list[Bristle]:
    """The friction as bristles, the stiffest first: fitted to the stop operators, and its own bristle as it is."""
    own = [p.bristle] if p.bristle.coulomb > 0.0 else []
    if sum(p.operators.weight) <= 0.0:
        return own
    limits, slips = _fitted(p.operators)
    return [Bristle(c, c / r, stribeck=p.stribeck) for c, r in zip(limits, slips, strict=True) if c > 0.0] + own


def gaussian(p: Stribeck) -> Stribeck:
    """The Stribeck curve of shape 2 that is nearest to `p`, over a few of its speeds."""
    if p.rise == 0.0 or p.shape == GAUSSIAN:
        return p
    speeds = np.linspace(0.0, CURVE_REACH * p.velocity, CURVE_POINTS)
    wanted = np.exp(-((speeds / p.velocity) ** p.shape))
    tried = p.velocity * np.geomspace(1.0 / CURVE_REACH, CURVE_REACH, CURVE_POINTS)
    curves = np.exp(-((speeds / tried[:, None]) ** GAUSSIAN))
    sizes = curves @ wanted / np.sum(curves * curves, axis=1)
    best = int(np.argmin(np.sum((sizes[:, None] * curves - wanted) ** 2, axis=1)))
    return Stribeck(p.rise * float(sizes[best]), float(tried[best]), GAUSSIAN)


def _fitted(p: StopOperators) -> tuple[list[float], list[float]]:
    """Limits (N m | N) and slips (rad | m) of the ladder."""
    from scipy.optimize import nnls

    weight, slip = np.array(p.weight), np.array(p.slip)
    x = np.geomspace(slip.min() / 10.0, slip.max() * 10.0, CURVE_POINTS)
    slips = np.geomspace(slip.min() / LADDER_REACH, slip.max(), LADDER)
    wanted = np.minimum(x[:, None] / slip, 1.0) @ weight
    limits, _ = nnls(1.0 - np.exp(-x[:, None] / slips), wanted)
    limits *= weight.sum() / limits.sum()
    return limits.tolist(), slips.tolist()


def to_mujoco(setup: Setup, path: Path) -> ExportedModel:
    """Write the MJCF file `path` and, for stop operators, the passive force beside it; run both in MuJoCo.

    Raises ExportError where a file cannot be written.
    """
    friction = path.with_name(f"{path.stem.replace('-', '_')}_friction.py")
    exact = operators(setup.stage)
    files = {path: model(setup)} | ({friction: callback(setup.stage)} if exact else {})
    write_texts(files)
    variants = {path.name: compared(setup, simulated(setup, path))}
    if exact:
        variants[f"{path.name} with {friction.name}"] = compared(setup, simulated(setup, path, friction))
    losses = [*lost(setup, HELD), *_shapes(setup)]
    return ExportedModel(f"MuJoCo {mujoco.__version__}", tuple(files), variants, losses)


def _shapes(setup: Setup) -> list[str]:
    """Shapes of the friction that the file has in another form."""
    p, words = setup.stage.friction, []
    if operators(setup.stage):
        words.append(
            "friction: stop operators, which the XML file alone has as fitted bristles; the Python file has them"
        )
    for stribeck in (p.stribeck, p.bristle.stribeck):
        if stribeck.rise and stribeck.shape != GAUSSIAN:
            words.append(f"friction.stribeck.shape = {stribeck.shape:g}: the XML file has a fitted Gaussian, shape 2")
    if p.bristle.coulomb and p.bristle.exponent != 1.0:
        words.append(f"friction.exponent = {p.bristle.exponent:g}: in the XML file the approach is exponential, 1")
    return words


def simulated(setup: Setup, xml: Path, callback: Path | None = None) -> Simulated:
    """What runs commands through the model of the file `xml`, with the passive force of `callback`."""

    def run(current: Array) -> Array:
        model = mujoco.MjModel.from_xml_path(str(xml))
        try:
            if callback is not None:
                _loaded(callback).install(model)
            return _positions(model, current, round(setup.dt / model.opt.timestep))
        finally:
            mujoco.set_mjcb_passive(None)

    return run


def _positions(model: Any, current: Array, steps: int) -> Array:
    data, found = mujoco.MjData(model), np.empty(len(current))
    mujoco.mj_resetDataKeyframe(model, data, 0)
    for k, command in enumerate(current):
        found[k], data.ctrl[0] = data.qpos[0], command
        mujoco.mj_step(model, data, steps)
    return found


def _loaded(path: Path) -> Any:
    spec = importlib.util.spec_from_file_location(path.stem, path)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module
