"""A recording as MCAP, which Foxglove, PlotJuggler and the readers of ROS 2 open: one message a period.

Messages are CDR with their definition in the file (``ros2msg``): nobody needs ours beforehand.  A row is the
encapsulation header and its float64 one after the other; fields are named as the columns of the CSV, with their units.
The recording's own meta is the metadata record ``stagectl``, its configuration files are attachments.
"""

import json
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stagectl.extras import require
from stagectl.recording.hdf5 import Recording
from stagectl.recording.metadata import made_at
from stagectl.replacing import replaced

TOPIC, DEFINITION = "/axis", "stagectl_msgs/msg/Period"
CDR = b"\x00\x01\x00\x00"  # little-endian; what follows is aligned to its end


def write(recording: Recording, path: Path, fields: dict[str, tuple[str, str]]) -> None:
    """Write it; `fields` are the columns in their order: name with unit, and meaning.

    Raises MissingExtraError where the package `mcap` is not installed.
    """
    require("mcap", "an MCAP file")
    from mcap.writer import Writer

    times = _times(recording)
    rows = np.column_stack([recording.column(name) for name in fields]).astype("<f8", copy=False)
    with replaced(path) as fresh, fresh.open("wb") as file:
        writer: Any = Writer(file)
        writer.start(profile="ros2", library="stagectl")
        schema = writer.register_schema(DEFINITION, "ros2msg", definition(fields).encode())
        channel = writer.register_channel(TOPIC, "cdr", schema)
        for number, (time, row) in enumerate(zip(times.tolist(), rows, strict=True)):
            writer.add_message(channel, time, CDR + row.tobytes(), time, number)
        writer.add_metadata("stagectl", {"meta": json.dumps(recording.meta), "ended": recording.ended})
        for carried in recording.meta.get("files", {}).values():
            text = carried["text"].encode()
            writer.add_attachment(int(times[0]), int(times[0]), carried["name"], "application/yaml", text)
        writer.finish()


def definition(fields: dict[str, tuple[str, str]]) -> str:
    """The message in ROS 2's language, each field with its meaning."""
    return "".join(f"float64 {name}  # {meaning}\n" for name, meaning in fields.values())


def _times(recording: Recording) -> NDArray[np.int64]:
    """Wall-clock time of each row (ns): the recording's beginning, and on by its own clock."""
    try:
        began = made_at(recording.meta)
    except (KeyError, ValueError):
        began = 0.0
    seconds = recording.column("time")
    times: NDArray[np.int64] = np.round((seconds - seconds[0]) * 1e9).astype(np.int64)
    return np.add(times, int(began) * 1_000_000_000)
