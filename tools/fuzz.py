"""A million frames, random and mutated, at the virtual drive and at the controller: no crash, no hang, no motion.

python tools/fuzz.py [FRAMES] [SEED]
"""

import logging
import os
import sys
import time
from pathlib import Path

os.environ["STAGECTL_KERNELS"] = "interpreted"
sys.path.insert(0, str(Path(__file__).parents[1]))

from tests.drives.fuzzing import fuzz_controller, fuzz_node


def main() -> None:
    frames = int(sys.argv[1]) if len(sys.argv) > 1 else 1_000_000
    logging.disable(logging.CRITICAL)  # the library says what it does not support
    seed = int(sys.argv[2]) if len(sys.argv) > 2 else 1
    for name, fuzz in (("virtual drive", fuzz_node), ("controller", fuzz_controller)):
        began = time.monotonic()
        tally = fuzz(frames, seed)
        print(f"{name}: {frames} frames, seed {seed}, {time.monotonic() - began:.0f} s: {tally}", flush=True)


if __name__ == "__main__":
    main()
