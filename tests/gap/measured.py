"""Measured records of other people's machines as sessions, with the fewest lines that describe each machine.

The records lie next to this repository (`../shared/data`, or where STAGECTL_RECORDS says); else tests skip.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from scipy.io import loadmat

from stagectl.config.stage_file import load_stage
from stagectl.gap.logs.load_session import load
from stagectl.gap.logs.session import Array, Session

ROOT = Path(__file__).resolve().parents[2]
DATA = Path(os.environ.get("STAGECTL_RECORDS", ROOT.parent / "shared" / "data"))
TURN = 2.0 * np.pi
UR_GAINS = (10.0, 10.70, 8.46, 9.00, 9.48, 10.12)  # N m/A, published with the record

ODRIVE = {"kind": "rotary", "force_constant": 0.0551, "inertia": 2.5e-4, "encoder_step": TURN / 8192}
HSM = {"kind": "rotary", "force_constant": 0.0458, "inertia": 1.2e-4, "viscous": 7.03e-5, "encoder_step": TURN / 1e4}
CNC_FORCE_CONSTANT = 1.31  # N m/A
CNC = {"kind": "rotary", "force_constant": CNC_FORCE_CONSTANT, "inertia": 4.5e-4, "encoder_step": TURN / 2**20}


def record(*parts: str) -> Path:
    """The path of a record; skips the test where it is absent."""
    path = DATA.joinpath(*parts)
    if not path.exists():
        pytest.skip(f"the measured record {'/'.join(parts)} is not beside this repository (../shared/data)")
    return path


def session(place: Path, stage: Mapping[str, Any], logs: Mapping[str, Mapping[str, Array]], repeats: bool) -> Session:
    """Logs by name, columns by header, as a folder of captures; `repeats` of one experiment, or one each."""
    place.mkdir(parents=True, exist_ok=True)
    captures = []
    for number, (name, columns) in enumerate(logs.items(), 1):
        header = ",".join(columns)
        np.savetxt(
            place / f"{name}.csv", np.column_stack(list(columns.values())), "%.12g", ",", header=header, comments=""
        )
        captures.append(
            {"file": f"{name}.csv", "experiment": "all" if repeats else name, "repeat": number if repeats else 1}
        )
    (place / "captures.yaml").write_text(yaml.safe_dump({"captures": captures}))
    (place / "nominal.yaml").write_text(yaml.safe_dump({"stage": dict(stage)}))
    return load([place])


def emps() -> Session:
    """The benchmark's record with our stage file, whose delay of a period is wrong."""
    return load([record("emps", "DATA_EMPS.mat")], load_stage(ROOT / "config" / "emps.yaml"))


def odrive(place: Path, *names: str) -> Session:
    """Position and current of a bare motor, polled."""
    logs = {}
    for name in names:
        t, position, current = np.asarray(loadmat(record("odrive", f"{name}.mat"))["data"], dtype=float)
        logs[name] = {"time_s": t - t[0], "position_rad": position * TURN / 8192, "current_A": current}
    return session(place, ODRIVE, logs, repeats=False)


def hsm150(place: Path, *names: str) -> Session:
    """Commanded torque and measured current of a servo motor that turns one way in each record."""
    logs = {}
    for name in names:
        d = np.asarray(loadmat(record("hsm150", f"{name}.mat"))["data"], dtype=float)
        command = d[:, 4] / HSM["force_constant"]
        logs[name] = {"time_s": d[:, 0] - d[0, 0], "position_rad": d[:, 2], "command_A": command, "current_A": d[:, 6]}
    return session(place, HSM, logs, repeats=False)


def cnc(place: Path, *names: str) -> Session:
    """Pulses of torque on the motor of a ball screw."""
    logs = {}
    for name in names:
        text = record("cnc_y_axis", f"20220531_Y_Axis_{name}.csv").read_text(errors="ignore").splitlines()
        rows = np.array([[float(word) for word in line.split("\t")[:60]] for line in text if line[:1].isdigit()])
        command = rows[:, 57] / 1000 * 2.37 / CNC_FORCE_CONSTANT
        position = rows[:, 9] * TURN / 2**20
        logs[name] = {
            "time_s": 1e-3 * (rows[:, 8] - rows[0, 8]),
            "position_rad": position,
            "command_A": command,
            "current_A": rows[:, 27],
        }
    return session(place, CNC, logs, repeats=False)


def ur10e(place: Path, joint: int, inertia: float) -> Session:
    """One joint of a robot, at about 94 Hz; `inertia` (kg m^2) is a guess, as no model comes with the record."""
    a = np.genfromtxt(record("ur10e_joints", f"ur-20_01_22-joint_{joint}.csv"), delimiter=",")
    a = a[np.all(np.isfinite(a[:, :25]), axis=1)]
    columns = {"position_rad": a[:, joint], "command_A": a[:, 18 + joint], "current_A": a[:, 12 + joint]}
    stage = {"kind": "rotary", "force_constant": UR_GAINS[joint - 1], "inertia": inertia}
    return session(place, stage, {f"joint-{joint}": {"time_s": a[:, 0] - a[0, 0], **columns}}, repeats=False)
