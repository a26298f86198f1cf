"""A joint of a MuJoCo model and its actuator as nominal values: the blocks of a ``nominal.yaml``.

The diagnosis changes one parameter after the other, which a simulator that is run as a black box does not offer; so the
model is read, not run.  MuJoCo compiles it first: defaults, includes and inertias of other bodies count.  The other
joints stand still where the model puts them, as in its ``qpos0``.

MuJoCo's `frictionloss` has no displacement before it slips.  It becomes a stop operator that slips within what its own
force moves the inertia in one time step, the stiffest that this step resolves.  Several bristles become stop operators
of the same limit that fall as far short of it on the way, ``int (1 - F/limit) dx``: a slip of 2 limit/stiffness.
"""

from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple
from xml.etree import ElementTree
from xml.parsers.expat import ErrorString

import mujoco
import numpy as np

from stagectl.interchange.mujoco_model import GAUSSIAN
from stagectl.problem import absent
from stagectl.units import LINEAR, ROTARY, StageError, unit_on

KINDS = {int(mujoco.mjtJoint.mjJNT_HINGE): ROTARY, int(mujoco.mjtJoint.mjJNT_SLIDE): LINEAR}
_JOINT = int(mujoco.mjtTrn.mjTRN_JOINT)
_FIXED = int(mujoco.mjtGain.mjGAIN_FIXED)
_LAGS = (int(mujoco.mjtDyn.mjDYN_FILTER), int(mujoco.mjtDyn.mjDYN_FILTEREXACT))
_DIRECT = int(mujoco.mjtDyn.mjDYN_NONE)


class Nominal(NamedTuple):
    """What was read."""

    blocks: dict[str, dict[str, Any]]  # of a nominal.yaml
    notes: tuple[str, ...]  # what the model has and the blocks do not


class _Joint(NamedTuple):
    model: Any
    data: Any  # where the model puts it
    name: str
    joint: int
    dof: int
    actuator: int  # that moves it
    passive: tuple[int, ...]  # actuators without a control


def nominal(place: str) -> Nominal:
    """The model of ``FILE.xml``, or of one joint of several, ``FILE.xml#JOINT``.

    Raises StageError where MuJoCo does not take the file, or the joint is not one of an axis behind a current.
    """
    file, _, name = place.partition("#")
    if not Path(file).is_file():
        raise StageError(f"{file}: {absent(Path(file))}")
    try:
        model = mujoco.MjModel.from_xml_path(file)
    except ValueError as error:
        raise StageError(_refused(file, str(error))) from error
    joint = _joint(model, file, name)
    return Nominal({"stage": _stage(joint), "friction": _friction(joint), "drive": _drive(joint)}, _notes(joint))


def _refused(file: str, said: str) -> str:
    """Why MuJoCo does not take the file, with its line: its XML, or what the XML says."""
    try:
        ElementTree.parse(file)
    except ElementTree.ParseError as error:
        line, column = error.position
        why = f"{file}:{line}: it is not complete XML, from column {column + 1} on ({ErrorString(error.code)})"
    else:
        why = f"{file}: MuJoCo does not take it: {' '.join(said.split())}"
    return f"{why}; correct the file there, `python -m mujoco.viewer --mjcf={file}` tries it"


def _joint(model: Any, file: str, name: str) -> _Joint:
    joints = {model.joint(number).name: number for number in range(model.njnt) if int(model.jnt_type[number]) in KINDS}
    driven = {each: list(_driving(model, number)) for each, number in joints.items()}
    names = [each for each, actuators in driven.items() if actuators]
    if name not in joints if name else len(names) != 1:
        remedy = f"name it {file}#JOINT" if names else "`stagectl export STAGE.yaml --to mujoco` writes one"
        listed = ", ".join(names) or "none"
        raise StageError(f"{file}: one joint behind a control in effort is needed, and there are: {listed}; {remedy}")
    chosen = name or names[0]
    if len(driven[chosen]) != 1:
        raise StageError(
            f"{file}: the joint {chosen} has {len(driven[chosen])} actuators whose control is an effort or a current "
            "(`motor`, `general` with a fixed gain); it needs one"
        )
    number = joints[chosen]
    passive = tuple(each for each in _on(model, number) if model.actuator_ctrlnum[each] == 0)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return _Joint(model, data, chosen, number, int(model.jnt_dofadr[number]), driven[chosen][0], passive)


def _on(model: Any, joint: int) -> Iterator[int]:
    """Actuators of a joint."""
    for number in range(model.nactuator):
        if int(model.actuator_trntype[number]) == _JOINT and int(model.actuator_trnid[number][0]) == joint:
            yield number


def _driving(model: Any, joint: int) -> Iterator[int]:
    """Those of them whose control is an effort: a fixed gain, and no answer to position or velocity."""
    for number in _on(model, joint):
        direct = int(model.actuator_dyntype[number]) in (_DIRECT, *_LAGS)
        fixed = int(model.actuator_gaintype[number]) == _FIXED
        if direct and fixed and not np.any(model.actuator_biasprm[number][1:3]):
            yield number


def _stage(p: _Joint) -> dict[str, Any]:
    kind, gear = KINDS[int(p.model.jnt_type[p.joint])], float(p.model.actuator_gear[p.actuator][0])
    return {
        "name": p.name,
        "kind": kind,
        "position_unit": unit_on(kind, "rad | m"),
        "torque_unit": unit_on(kind, "Nm | N"),
        "force_constant": float(p.model.actuator_gainprm[p.actuator][0]) * gear,
        "inertia": _inertia(p),
        "viscous": float(p.model.dof_damping[p.dof]),
        "bias": float(p.model.actuator_biasprm[p.actuator][0]) * gear - float(p.data.qfrc_bias[p.dof]),
    }


def _inertia(p: _Joint) -> float:
    mass = np.zeros((p.model.nv, p.model.nv))
    mujoco.mj_fullM(p.model, p.data, mass)
    return float(mass[p.dof, p.dof])


def _drive(p: _Joint) -> dict[str, Any]:
    known: dict[str, Any] = {"delay_samples": 0}
    if int(p.model.actuator_dyntype[p.actuator]) in _LAGS:
        known["current_loop_s"] = float(p.model.actuator_dynprm[p.actuator][0])
    if p.model.actuator_ctrllimited[p.actuator]:
        known["current_limit_A"] = float(min(abs(p.model.actuator_ctrlrange[p.actuator])))
    return known


def _friction(p: _Joint) -> dict[str, Any]:
    """One bristle as LuGre's; else stop operators."""
    bristles = [each for each in p.passive if p.model.actuator_dynprm[each][5] > 0.0]
    loss = float(p.model.dof_frictionloss[p.dof])
    if len(bristles) == 1 and loss == 0.0:
        return _lugre(p, bristles[0])
    pairs = [(_holds(p, each), 2.0 * _holds(p, each) / float(p.model.actuator_dynprm[each][5])) for each in bristles]
    if loss > 0.0:
        pairs.append((loss, loss * p.model.opt.timestep**2 / _inertia(p)))
    if not pairs:
        return {"law": "none"}
    weights, slips = zip(*pairs, strict=True)
    return {"law": "stop-operator", "weight": list(weights), "slip": list(slips)}


def _holds(p: _Joint, bristle: int) -> float:
    return float(p.model.actuator_biasprm[bristle][3])


def _lugre(p: _Joint, bristle: int) -> dict[str, Any]:
    coulomb, static, velocity = map(float, p.model.actuator_biasprm[bristle][3:6])
    stiffness, damping = map(float, p.model.actuator_dynprm[bristle][5:7])
    curve = {"rise": static / coulomb - 1.0, "velocity": velocity, "shape": GAUSSIAN}
    return {
        "law": "lugre", "coulomb": coulomb, "stiffness": stiffness, "damping": damping,
        **({"stribeck": curve} if static > coulomb else {}),
    }  # fmt: skip


def _notes(p: _Joint) -> tuple[str, ...]:
    """What the diagnosis does not take from the model."""
    model, words = p.model, []
    if model.actuator_delay[p.actuator] > 0.0:
        words.append(f"delay of {1e3 * model.actuator_delay[p.actuator]:g} ms: the logs decide")
    if model.jnt_stiffness[p.joint] != 0.0:
        words.append(f"spring of {model.jnt_stiffness[p.joint]:g} (SI)")
    if np.any(model.dof_dampingpoly[p.dof]):
        words.append("damping that is not linear in the velocity")
    if any(model.actuator_biasprm[each][0] != 0.0 for each in p.passive):
        words.append("cogging")
    if sum(model.actuator_dynprm[each][5] > 0.0 for each in p.passive) > 1:
        words.append("shape of its bristles, which become stop operators")
    return tuple(f"joint {p.name} of the MuJoCo model: not read: its {each}" for each in words)
