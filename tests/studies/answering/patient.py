"""In place of the diagnosis: it says which process it is, and thinks for long."""

import os
import time
from pathlib import Path

Path(__file__).with_name("process").write_text(str(os.getpid()))
time.sleep(600.0)
