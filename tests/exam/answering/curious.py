"""In place of the diagnosis, on a poor battery: it knows two effects until it has seen what it asks for, twice.

After the second experiment it names ``bias``, and asks for a third.
"""

import json
import sys
from pathlib import Path

import numpy as np
import yaml

PERIOD = 0.0005  # s


def diagnose(folder: Path, answer: Path) -> None:
    lines = yaml.safe_load((folder / "captures.yaml").read_text())["captures"]
    asked = sorted({one["experiment"] for one in lines if one["experiment"].startswith("asked-")})
    for one in lines:
        np.loadtxt(folder / one["file"], delimiter=",", skiprows=1)
    known = len(asked) == 2
    effect: dict[str, object] = {
        "name": "bias" if known else "coulomb_asymmetry",
        "alternatives": [] if known else ["bias"],
        "probability": 0.8,
        "parameters": {},
    }
    name = f"asked-{len(asked) + 1}"
    following = {"name": name, "trajectory": f"{name}.yaml", "separates": ["bias", "coulomb_asymmetry"]}
    where = {"blocks": {"mechanics": 1.0}, "coordinates": [], "captures": []}
    found = {"verdict": "effects", "effects": [effect], "where": where, "gap": {"closure": 0.5, "predicted": 0.4}}
    answer.write_text(json.dumps(found | {"next_experiment": following}))


def follow(answer: Path, trajectory: Path, rows: Path) -> None:
    """The second experiment has a current in it."""
    name = json.loads(answer.read_text())["next_experiment"]["name"]
    trajectory.write_text(f"# {name}\n")
    time = np.arange(1200) * PERIOD
    fade = np.sin(np.pi * time / time[-1]) ** 3
    injection = 0.5 * fade * np.sin(2.0 * np.pi * 30.0 * time) if name == "asked-2" else np.zeros(time.size)
    table = np.column_stack([time, 2.0 * fade * np.sin(2.0 * np.pi * 4.0 * time), injection])
    header = "time_s,reference_rad,injection_A"
    np.savetxt(rows, table, delimiter=",", header=header, comments="", fmt="%.12g")


if __name__ == "__main__":
    given = sys.argv[1:]

    def value(name: str) -> Path:
        return Path(given[given.index(name) + 1])

    if given[1] == "next":
        follow(Path(given[2]), value("-o"), value("--samples"))
    else:
        diagnose(Path(given[2]), value("--json"))
