"""In place of the diagnosis: always the same answer, and the measured runs as prediction.

On a poor battery (without a scan) it knows two effects, until it has seen what it asks for, twice: then it names one,
and asks for a third experiment.  Beside a file named ``deadly`` it kills the worker that began it, beside one named
``dying`` itself; each once, and where the file holds a word only in a command that has it.
"""

import itertools
import json
import os
import signal
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import yaml

PERIOD = 0.0005  # s


def diagnose(folder: Path, answer: Path, predictions: Path) -> None:
    lines = yaml.safe_load((folder / "captures.yaml").read_text())["captures"]
    names = {line["experiment"] for line in lines}
    asked = sum(name.startswith("asked-") for name in names)
    said = told("cogging", "encoder_eccentricity") if "scan" in names else poorly(asked)
    spans = [{"file": line["file"], "spans": [[0.0, 1.0]]} for line in lines if line["use"] == "diagnose"]
    where = {"blocks": {"mechanics": 0.9, "sensor": 0.1}, "coordinates": [], "captures": spans}
    reply = {"verdict": "effects", "where": where, "gap": {"closure": 0.5, "predicted": 0.4}, **said}
    answer.write_text(json.dumps(reply))
    predictions.mkdir()
    for line in lines:
        rows = np.loadtxt(folder / line["file"], delimiter=",", skiprows=1)
        if line["use"] == "held-out":
            content = rows[:, [0, 1, 4]]
            header = "time_s,position_rad,current_A"
            np.savetxt(predictions / line["file"], content, delimiter=",", header=header, comments="")


def told(name: str, *alternatives: str) -> dict[str, Any]:
    effect = {"name": name, "alternatives": alternatives, "probability": 0.8, "parameters": {}}
    return {"effects": [effect], "next_experiment": None}


def poorly(asked: int) -> dict[str, Any]:
    name = f"asked-{asked + 1}"
    following = {"name": name, "trajectory": f"{name}.yaml", "separates": ["bias", "coulomb_asymmetry"]}
    return (told("bias") if asked == 2 else told("coulomb_asymmetry", "bias")) | {"next_experiment": following}


def follow(answer: Path, trajectory: Path, rows: Path) -> None:
    """The second experiment has a current in it."""
    name = json.loads(answer.read_text())["next_experiment"]["name"]
    trajectory.write_text(f"# {name}\n")
    clock = np.arange(1200) * PERIOD
    fade = np.sin(np.pi * clock / clock[-1]) ** 3
    injection = 0.5 * fade * np.sin(2.0 * np.pi * 30.0 * clock) if name == "asked-2" else np.zeros(clock.size)
    table = np.column_stack([clock, 2.0 * fade * np.sin(2.0 * np.pi * 4.0 * clock), injection])
    header = "time_s,reference_rad,injection_A"
    np.savetxt(rows, table, delimiter=",", header=header, comments="", fmt="%.12g")


def kill_once(name: str, process: int) -> None:
    path = Path(__file__).with_name(name)
    try:
        if path.read_text() not in " ".join(sys.argv):
            return
        path.unlink()
    except FileNotFoundError:
        return
    os.kill(process, signal.SIGKILL)
    time.sleep(60.0)  # it ends with its worker


if __name__ == "__main__":
    given = sys.argv[1:]
    options = {name: Path(value) for name, value in itertools.pairwise(given)}
    kill_once("deadly", os.getppid())
    kill_once("dying", os.getpid())
    if given[1] == "next":
        follow(Path(given[2]), options["-o"], options["--samples"])
    else:
        diagnose(Path(given[2]), options["--json"], options["--predictions"])
