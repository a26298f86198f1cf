"""MATLAB files as logs: our own exports, the EMPS benchmark's layout, and variables that say what they are."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from scipy.io import loadmat

from stagectl.config.stage_file import Setup
from stagectl.problem import ProblemKind
from stagectl.recording.columns import Array, Choice, Log, Stated, check_kind, check_once, choices, of_choices, parsed
from stagectl.recording.constants import EMPS_STEP, NEARLY_AS_LONG
from stagectl.recording.hdf5 import RecordingError, quantities
from stagectl.recording.metadata import flat
from stagectl.recording.scales import Scales, scales_of_stage
from stagectl.units import LINEAR

_EMPS = {"t": "time", "qg": "reference", "qm": "measured", "vir": "command"}


def read(path: Path, stated: Stated) -> Log:
    """The log in a MATLAB file; what is `stated` names its variables where they do not, and the scales that it lacks.

    Raises RecordingError naming the variables that there are.
    """
    content = variables(path)
    if chosen := choices(stated.columns):
        return _chosen(path, content, chosen, stated)
    if isinstance(content.get("samples"), dict) and isinstance(content.get("meta"), str):
        return _ours(path, content, stated.taken)
    if {"t", "qm", "vir", "gtau"} <= content.keys():  # others, too, call their time t
        return _emps(path, content, stated.setup)
    _check_lengths(path, content)
    named = {name: meaning for name in flat(content) if (meaning := parsed(name.rsplit(".", 1)[-1]))}
    present = {quantity for quantity, _ in named.values()}
    absent = [quantity for quantity in ("time", "position") if quantity not in present]
    if absent:
        reason = (
            f"{path} has no {' and no '.join(absent)} by that name; it holds "
            f"{', '.join(flat(content)) or 'nothing'}: say which is which, such as "
            "--columns time=t,position=q:mm,current=i"
        )
        raise RecordingError(reason, path, ProblemKind.MISSING, column=absent[0])
    chosen = [Choice(quantity, name, 0, unit) for name, (quantity, unit) in named.items()]
    return _chosen(path, content, chosen, stated)


def _check_lengths(path: Path, content: Mapping[str, Any]) -> None:
    """Raise RecordingError where a vector is about as long as the longest, a column that has lost rows or found some.

    What is much shorter is a parameter or another record.
    """
    rows = {name: np.size(value) for name, value in flat(content).items() if np.asarray(value).dtype.kind in "fiu"}
    longest = max(rows, key=lambda name: rows[name], default="")
    for name, count in rows.items():
        if NEARLY_AS_LONG * rows[longest] <= count < rows[longest]:
            reason = (
                f"{path}: {name} has {count} rows, {longest} has {rows[longest]}; columns of one log must have "
                "the same number: save it again with all rows, or name those that belong together with --columns"
            )
            raise RecordingError(reason, path, ProblemKind.SHAPE, column=name)


def variables(path: Path) -> dict[str, Any]:
    """Variables of the file by name, structs as dictionaries.  Raises RecordingError where it cannot be read."""
    try:
        content = loadmat(path, simplify_cells=True)
    except Exception as error:  # scipy raises many kinds on a file that is damaged
        reason = f"{path} cannot be read as a MATLAB file: {error}; save it again, with -v7"
        if isinstance(error, NotImplementedError):
            reason = f"{path} is a MATLAB 7.3 file; save it with -v7 and import that"
        raise RecordingError(reason, path, ProblemKind.SYNTAX) from error
    return {name: value for name, value in content.items() if not name.startswith("__")}


def _chosen(path: Path, content: dict[str, Any], chosen: list[Choice], stated: Stated) -> Log:
    scales, found = of_choices(chosen, stated, path)
    check_once(path, {choice.quantity: ((choice.name, choice.number), choice.name) for choice, _ in found.values()})
    columns = {ours: scale * _vector(path, content, choice) for ours, (choice, scale) in found.items()}
    taken_in = {choice: "s" if choice.quantity == "time" else "A" for choice in chosen if not choice.said}
    notes = [f"{one.name} has no unit: it is taken as the {one.quantity} in {unit}" for one, unit in taken_in.items()]
    return _log(path, scales, columns, notes, {})._replace(labels={ours: one.name for ours, (one, _) in found.items()})


def _vector(path: Path, variables: Mapping[str, Any], choice: Choice) -> Array:
    named = flat(variables)
    if choice.name not in named:
        reason = f"{path} has no {choice.name}; it holds {', '.join(named) or 'nothing'}"
        raise RecordingError(reason, path, ProblemKind.UNKNOWN, column=choice.name)
    try:
        values = np.asarray(named[choice.name], dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise RecordingError(
            f"{choice.name} in {path} does not hold numbers", path, ProblemKind.VALUE, column=choice.name
        ) from error
    if choice.number:
        shape, values = values.shape, upright(values)
        if values.ndim != 2 or choice.number > values.shape[1]:
            reason = f"{choice.name}[{choice.number}] in {path}: {choice.name} has shape {shape}"
            raise RecordingError(reason, path, ProblemKind.UNKNOWN, column=choice.name)
        return np.ascontiguousarray(values[:, choice.number - 1])
    if values.ndim > 1:
        reason = (
            f"{choice.name} in {path} is a table of shape {values.shape}: say which column, {choice.name}[1] the first"
        )
        raise RecordingError(reason, path, ProblemKind.SHAPE, column=choice.name)
    return values.ravel()


def upright(values: Array) -> Array:
    """A table (n, columns); one that lies on its side, (columns, n), is turned."""
    return values.T if values.ndim == 2 and values.shape[1] > values.shape[0] > 1 else values


def _log(path: Path, scales: Scales, columns: dict[str, Array], notes: list[str], about: dict[str, Any]) -> Log:
    if len({len(column) for column in columns.values()}) > 1:
        sizes = ", ".join(f"{name} {len(column)}" for name, column in columns.items())
        raise RecordingError(f"{path}: its columns differ in length ({sizes})", path, ProblemKind.SHAPE)
    return Log(path, scales, columns, notes, about)


def _ours(path: Path, variables: dict[str, Any], taken: Scales | None) -> Log:
    """A recording that `export --to mat` wrote."""
    try:
        axis = json.loads(variables["meta"])["axis"]
        kind, per_unit, unit = axis["kind"], axis["travel_per_unit"], axis["travel_unit"]
    except (ValueError, KeyError, TypeError) as error:
        reason = f"{path} has samples and meta as our exports do, but its meta cannot be read"
        raise RecordingError(reason, path, ProblemKind.SYNTAX) from error
    check_kind(path, f"positions of a {kind} axis", kind, taken)
    known = quantities()
    columns = {name: np.ravel(values) for name, values in variables["samples"].items() if name in known}
    return _log(path, Scales(kind, per_unit, unit, axis.get("encoder_step") or 0.0), columns, [], {})


def _emps(path: Path, variables: dict[str, Any], setup: Setup | None) -> Log:
    """The benchmark's file: an amplifier of 1 A/V is taken, so that its volts are our amperes."""
    check_kind(path, "positions in m, as the EMPS layout means", LINEAR, scales_of_stage(setup) if setup else None)
    columns = {ours: np.ravel(variables[name]).astype(np.float64) for name, ours in _EMPS.items() if name in variables}
    gain = _scalar(variables, "gtau") or 0.0
    scales = scales_of_stage(setup, 1.0) if setup else Scales(LINEAR, 1.0, "m", EMPS_STEP, gain, 1.0)
    notes = [
        f"EMPS layout: vir (V) is kept as the command in A of an amplifier of 1 A/V, so gtau = {gain:.6g} N/V is the "
        "force constant in N/A"
    ]
    return _log(path, scales, columns, notes, {"name": "EMPS", "nominal": _emps_nominal(variables, gain)})


def _scalar(variables: Mapping[str, Any], name: str) -> float | None:
    values = np.ravel(variables[name]) if name in variables else np.zeros(0)
    return float(values[0]) if values.size else None


def _emps_nominal(variables: Mapping[str, Any], gain: float) -> dict[str, Any]:
    return {
        "stage": {
            "name": "EMPS",
            "kind": LINEAR,
            "position_unit": "m",
            "torque_unit": "N",
            "force_constant": gain or None,
            "travel_per_unit_mm": 1000.0,
            "encoder_step": EMPS_STEP,
        },
        "drive": {"amplifier_A_per_V": 1.0, "current_limit_A": 10.0},
        "controller": {
            "Ts": 1e-3,
            "law": "command[k] = kv (kp (reference[k] - position[k]) - dq[k]); dq[k] = (qf[k] - qf[k-1]) / Ts; "
            "qf[k] = (position[k] + position[k-1]) / 2; limited to 10 V",
            "kp": _scalar(variables, "kp"),
            "kv": _scalar(variables, "kv"),
        },
    }
