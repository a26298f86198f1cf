"""In place of the diagnosis: it says which process it is, and thinks for long."""

import os
import time
from pathlib import Path

PROCESS = Path(__file__).with_name("process")
PROCESS.with_suffix(".part").write_text(str(os.getpid()))
PROCESS.with_suffix(".part").rename(PROCESS)  # whole or not there
time.sleep(600.0)
