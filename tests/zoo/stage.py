"""Stage file and trajectory for a foreign drive: ``python -m tests.zoo.stage VARIANT FOLDER``."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

from stagectl.config.stage_blocks import StageFile
from stagectl.drives.drive import Canopen
from tests.zoo.objects import write_eds
from tests.zoo.plant import COULOMB, COUNTS, FORCE_CONSTANT, INERTIA, LEAD, RATED_CURRENT, VISCOUS
from tests.zoo.variants import Variant, named

NODE = 5
KNOWN = {"kind", *Canopen._fields}  # keys of `drive.wire` that this version has; others of the table are left out
CURRENT_LIMIT = 4.0  # A
PERIOD = 0.005  # s
TRAVEL = 0.2  # m to either side

_WIRE = {
    "kind": "canopen",
    "interface": "stagectl",  # the embedded bus, but taken as a real one: no virtual drive is started on it
    "channel": "zoo",
    "bitrate": "1 Mbit/s",
    "node": str(NODE),
    "eds": "zoo.eds",
    "rated_current": f"{RATED_CURRENT:g} A",
    "command_object": "0x6071_00",
    "command_scale": f"{RATED_CURRENT:g} mA",
    "current_object": "0x6077_00",
    "current_scale": f"{RATED_CURRENT:g} mA",
    "quick_stop_deceleration": "0.5 m/s^2",
    "reset": "none",
    "heartbeat": "50 ms",
    "heartbeat_timeout": "400 ms",
    "rpdo_timeout": "300 ms",
    "feedback_timeout": "300 ms",
    "identity": "{vendor: 0x2E1, product: 0x50402}",
}
_STAGE = """\
name: foreign drive
axis:
  kind: rotary
  lead: {lead:g} mm
motor:
  force_constant: {force_constant:g} N m/A
mechanics:
  inertia: {inertia:g} kg m^2
  viscous: {viscous:g} N m s/rad
  bias: {bias:g} N m
friction:
  law: rolling
  coulomb: {coulomb:g} N m
  elements: 4
  shortest: 5 um
  longest: 50 um
encoder:
  counts_per_revolution: {counts}
  delay_samples: {age}
drive:
  current_lag: 1 ms
  current_limit: {current_limit:g} A
  delay_samples: 1
  wire:
{wire}
control:
  period: {period:g} ms
  bandwidth: 4 Hz
  margin: 20 deg
  layers: [ptc]
limits:
  travel: [-{travel:g} mm, {travel:g} mm]
  speed: 80 mm/s
  acceleration: 0.5 m/s^2
  following_error: 3 mm
  encoder_jump: 3 mm
  encoder_freeze: 1 mm
realtime:
  priority: 80
  late_limit: 100
simulation:
  clock: wall
"""
_HOMING = "homing:\n  method: here\n"
_HOMING_BY_DRIVE = """homing:
  method: drive
  number: {number}
  speed: 5 mm/s
  slow: 1 mm/s
  distance: 4 mm
  position: 3 mm
"""
_BRAKE = "brake:\n  control: drive\n  release: {time:g} ms\n  engage: {time:g} ms\n"
MOTION = "type: sine\namplitude: 1 mm\nfrequency: 2 Hz\nperiods: 1\nramp: 1\n"
LONG_MOTION = "type: sine\namplitude: 2 mm\nfrequency: 1 Hz\nperiods: 60\nramp: 1\n"


class Files(NamedTuple):
    """What `run` wants."""

    stage: Path
    motion: Path
    bus: Path
    diary: Path


def write(folder: Path, variant: Variant, wire: Mapping[str, str] | None = None, motion: str = MOTION) -> Files:
    """The files in `folder`; the lines of `wire` come after those of the variant."""
    lines = {**_WIRE, **variant.wire, **(wire or {})}
    lines = {key: line for key, line in lines.items() if key in KNOWN}
    text = _STAGE.format(
        lead=1e3 * LEAD, force_constant=FORCE_CONSTANT, inertia=INERTIA, viscous=VISCOUS, coulomb=COULOMB,
        bias=-variant.gravity, counts=COUNTS,
        age=variant.tpdo_age * variant.age_told, current_limit=CURRENT_LIMIT, period=1e3 * PERIOD, travel=1e3 * TRAVEL,
        wire="\n".join(f"    {key}: {value}" for key, value in lines.items()),
    )  # fmt: skip
    files = Files(folder / "stage.yaml", folder / "motion.yaml", folder / "bus", folder / "diary.jsonl")
    text += _HOMING if variant.start_counts else ""
    text += _HOMING_BY_DRIVE.format(number=37 if variant.homing == "here" else 17) if variant.homing else ""
    text += _BRAKE.format(time=1e3 * variant.brake_time) if variant.gravity and "brake" in StageFile._fields else ""
    files.stage.write_text(text)
    files.motion.write_text(motion)
    write_eds(folder / "zoo.eds", variant, NODE)
    return files


def main() -> None:
    """Write the files of a variant for a person, and print what to type next."""
    name, folder = sys.argv[1], Path(sys.argv[2]).resolve()
    folder.mkdir(parents=True, exist_ok=True)
    files = write(folder, named(name))
    print(f"python -m tests.zoo.node {name} --channel {files.bus} --diary {files.diary}")
    print(f"python -m stagectl run {files.stage} {files.motion} --channel {files.bus} -o {folder / 'run.h5'}")


if __name__ == "__main__":
    main()
