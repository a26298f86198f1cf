"""What the user has not: the hidden effects, where each acts, and the runs without noise."""

import json
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stagectl_studies.machine.effects import Rig
from stagectl_studies.machine.machine import Floats
from stagectl_studies.machine.plant import Noise, Setting, Trace, ideal, simulated
from stagectl_studies.machine.shadow import command_share, current_share, position_share, reported_share, torque_share
from stagectl_studies.machine.trials import Capture, Trial, at_rest, quiet_noise

SHARE, QUANTILE = 0.2, 0.95


def changes(before: Any, other: Any, path: str = "") -> dict[str, Any]:
    """Fields in which two nested NamedTuples differ, with the first one's values."""
    changed: dict[str, Any] = {}
    for name in before._fields:
        a, b, here = getattr(before, name), getattr(other, name), f"{path}{name}"
        if hasattr(a, "_fields"):
            changed.update(changes(a, b, f"{here}."))
        elif isinstance(a, np.ndarray):
            if not np.array_equal(a, b):
                changed[here] = [float(value) for value in a]
        elif a != b:
            changed[here] = a
    return changed


def drifting(trial: Trial) -> bool:
    """Whether repeats differ by more than noise: something runs on the session's clock."""
    w = trial.rig.machine.warmth
    return any((w.coulomb_fast, w.coulomb_slow, w.viscous_fast, w.viscous_slow, w.step_coulomb, w.step_viscous))


def share_of(trial: Trial, number: int, trace: Trace, setting: Setting, noise: Noise) -> Floats:
    """Share of hidden effect `number` at each row of a run without noise, in its own unit."""
    rig, without = trial.rig, trial.without[number]
    kind = trial.hidden[number].seen_in
    if kind == "current":
        return current_share(rig, without, trace, noise)
    if kind == "reported":
        return reported_share(rig, without, trace, setting)
    if kind == "position":
        return position_share(rig, without, trace)
    if kind == "torque":
        return torque_share(without, trace, setting)
    raise ValueError(f"no share is defined for {kind}")


def quiet_run(trial: Trial, capture: Capture) -> tuple[Trace, list[Floats]]:
    """A capture without noise, and the share of each hidden effect in it."""
    rows = trial.rows[capture.experiment.name]
    noise = quiet_noise(trial.rig, rows.target.size, trial.seed)
    setting = Setting(start=capture.start, remanent=at_rest(trial, capture), fine=bool(trial.hidden))
    rig = Rig(ideal(trial.rig.machine), trial.rig.loop)
    trace = simulated(rig.machine, rig.loop, rows, noise, setting)
    shares = [
        command_share(trial.rig, trial.without[k], trace, rows)
        if effect.seen_in == "command"
        else share_of(trial, k, trace, setting, noise)
        for k, effect in enumerate(trial.hidden)
    ]
    return trace._replace(fine=np.zeros((0, 4))), shares


def size_of(shares: list[Floats]) -> float:
    """95 % quantile of an effect's share over all captures; of the rows where it acts, if they are fewer than 5 %."""
    sizes = np.abs(np.concatenate(shares))
    quantile = float(np.quantile(sizes, QUANTILE))
    least = 1e-3 * float(sizes.max())
    return quantile if quantile >= least else float(np.quantile(sizes[sizes > least], QUANTILE))


def places(shares: list[Floats]) -> list[NDArray[np.bool_]]:
    """Rows where an effect exceeds 20 % of its size."""
    size = size_of(shares)
    return [np.abs(share) > SHARE * size for share in shares]


def quiet_captures(trial: Trial) -> list[Capture]:
    """Captures whose runs without noise are told apart: all of a drifting stage, else one repeat."""
    return [capture for capture in trial.captures if capture.repeat == 1 or drifting(trial)]


def description(trial: Trial, sizes: list[float]) -> dict[str, Any]:
    """The truth in words and numbers."""
    body, model = trial.rig.machine.body, trial.model
    plain = trial.without[0].machine.body if len(trial.without) == 1 else body
    kept = {quiet_capture.file for quiet_capture in quiet_captures(trial)}
    return {
        "seed": trial.seed,
        "stratum": trial.stratum,
        "law": trial.law,
        "level": "limits each element" if trial.rig.machine.speed.limits else "scales the contact",
        "effects": [
            {
                "name": effect.name,
                "scale": effect.scale,
                "realised_scale": effect.realised,
                "seen_in": effect.seen_in,
                "companion": effect.companion,
                "share": sizes[k],
                "parameters": changes(trial.rig, trial.without[k]),
            }
            for k, effect in enumerate(trial.hidden)
        ],
        "true": {"inertia": body.inertia, "viscous": body.viscous, "coulomb": body.coulomb, "bias": body.bias},
        "nominal_over_plain": {
            "inertia": model.inertia / plain.inertia,
            "viscous": model.viscous / plain.viscous,
            "coulomb": float(model.weight.sum()) / plain.coulomb,
        },
        "noise_free": {
            capture.file: capture.file if capture.file in kept else f"{capture.experiment.name}-1.csv"
            for capture in trial.captures
        },
        "where": f"boolean rows of truth.npz: share beyond {SHARE:g} of its {QUANTILE:g} quantile",
    }


def write_truth(trial: Trial, folder: Path) -> None:
    """truth.json and truth.npz (position/FILE rad, current/FILE A, where/EFFECT/FILE).

    `share` in truth.json is the 95 % quantile of the effect's own torque (N m), current (A) or position (rad).
    """
    folder.mkdir(parents=True, exist_ok=True)
    arrays: dict[str, Any] = {}
    captures, shares = quiet_captures(trial), []
    for capture in captures:
        trace, share = quiet_run(trial, capture)
        arrays[f"position/{capture.file}"], arrays[f"current/{capture.file}"] = trace.position, trace.current
        shares.append(share)
    sizes = [size_of([share[k] for share in shares]) for k in range(len(trial.hidden))]
    for k, effect in enumerate(trial.hidden):
        marked = places([share[k] for share in shares])
        arrays |= {f"where/{effect.name}/{capture.file}": at for capture, at in zip(captures, marked, strict=True)}
    np.savez(folder / "truth.npz", **arrays)
    (folder / "truth.json").write_text(json.dumps(description(trial, sizes), indent=1), encoding="utf-8")
