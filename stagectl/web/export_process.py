"""One export as a process of its own, bounded: ``python -m stagectl.web.export_process RECORDING FORMAT FILE``."""

import sys
from pathlib import Path

from stagectl.service.child_process import confine
from stagectl.service.limits import EXPORT_FILE, EXPORT_MEMORY, EXPORT_TIME
from stagectl.units import StageError


def main() -> None:
    """Entry of the process; exit 1 with the reason on standard error."""
    confine(EXPORT_MEMORY, EXPORT_TIME, EXPORT_FILE)
    from stagectl.recording.exports import export
    from stagectl.recording.hdf5 import open_recording

    recording, to, target = sys.argv[1:]
    try:
        export([open_recording(Path(recording))], to, Path(target))
    except (StageError, OSError, MemoryError) as error:
        sys.exit(f"{error or type(error).__name__}")


if __name__ == "__main__":
    main()
