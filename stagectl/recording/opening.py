"""What lies at a path: recordings of ours, or else logs of other programs."""

from collections.abc import Collection, Mapping
from pathlib import Path

from stagectl.config.stage_file import Setup
from stagectl.recording.hdf5 import Recording, open_recording
from stagectl.recording.scales import NOTHING_KNOWN, Scales


def recordings_at(
    path: Path,
    setup: Setup | None,
    columns: Mapping[str, str] | None = None,
    scales: Scales | None = None,
    only: Collection[str] = (),
) -> list[Recording]:
    """The recordings at `path`: a file, a folder of captures, of our recordings, or else of logs.

    `columns` and `scales` are for logs, as in `importing.import_log`, of whose guesses only a sure one is taken; `only`
    names the columns read of our recordings.

    Raises RecordingError where a file cannot be read, or a folder holds none.
    """
    if ours := own_recordings(path):
        return [open_recording(file, only) for file in ours]
    from stagectl.recording.guess.importing import import_log  # with pyarrow, 60 MB that our recordings need not

    return [log.recording for log in import_log(path, setup, columns, NOTHING_KNOWN, unsure=False, scales=scales)]


def own_recordings(path: Path) -> list[Path]:
    """The file `path` where it is a recording of ours, or those of a folder that does not list its captures."""
    if path.suffix == ".h5":
        return [path]
    return [] if (path / "captures.yaml").is_file() else sorted(path.glob("*.h5"))
