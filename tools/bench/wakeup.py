"""How late the loop's periods begin, beside cyclictest: ``python tools/bench/wakeup.py [SECONDS] [ROUNDS]``.

Slices of cyclictest (Debian: rt-tests), of the loop's metronome and of the metronome with a spin of 50 us follow each
other in one run, all at 1 kHz with SCHED_FIFO 80, memory locked and the same CPU, so that the machine disturbs all
alike.  The figures are medians over the rounds of each slice's quantiles, and their ratios; cyclictest counts in whole
us, cut off, of which the middle is taken.
"""

import json
import os
import re
import shutil
import statistics
import subprocess
import sys
import time
from pathlib import Path

if __name__ == "__main__":  # the page's process needs compiled ones
    os.environ["STAGECTL_KERNELS"] = "interpreted"
sys.path.insert(0, str(Path(__file__).parents[2]))

from stagectl.realtime import scheduling

PERIOD, PRIORITY, SPIN = 1e-3, 80, 50e-6  # s, -, s
SHARES = (0.5, 0.99, 0.999)
WANTED = {"metronome": (1.3, 1.5, 2.0), "with spin": (0.2, None, None)}  # times cyclictest
CPU = max(os.sched_getaffinity(0))


def quantiles(values: list[float]) -> list[float]:
    """Of lateness (us)."""
    values = sorted(values)
    return [values[min(int(share * len(values)), len(values) - 1)] for share in SHARES]


def cyclictest(seconds: float) -> list[float]:
    """One slice of it."""
    words = ["cyclictest", "-q", "-m", "-t1", f"-p{PRIORITY}", f"-i{PERIOD * 1e6:.0f}", f"-a{CPU}", "-h100000"]
    done = subprocess.run([*words, f"-l{seconds / PERIOD:.0f}"], capture_output=True, text=True, check=True)
    found = re.findall(r"(?m)^(\d+)\s+(\d+)$", done.stdout)
    late = [float(us) + 0.5 for us, count in found for _ in range(int(count))]
    return quantiles(late + [1e5] * (round(seconds / PERIOD) - len(late)))  # what its histogram does not hold


def metronome(seconds: float, spin: float) -> list[float]:
    """One slice of ours, in a process of its own."""
    done = subprocess.run([sys.executable, __file__, "-child", str(seconds), str(spin)], capture_output=True, text=True)
    if done.returncode:
        raise SystemExit(done.stderr)
    found: list[float] = json.loads(done.stdout)
    return found


def child(seconds: float, spin: float) -> None:
    """As the loop's process does it."""
    refused = scheduling.prepare(PRIORITY, CPU)
    if any("scheduling" in one for one in refused):
        raise SystemExit("; ".join(refused))
    one, late = scheduling.Metronome(PERIOD, spin=spin), []
    for _ in range(round(seconds / PERIOD)):
        late.append(1e6 * one.wait())
        one.missed()
    print(json.dumps(quantiles(late)))


def sliced(seconds: float, rounds: int) -> dict[str, list[list[float]]]:
    """Quantiles of all slices, round by round."""
    slices: dict[str, list[list[float]]] = {"cyclictest": [], "metronome": [], "with spin": []}
    for _ in range(rounds):
        slices["cyclictest"].append(cyclictest(seconds))
        slices["metronome"].append(metronome(seconds, 0.0))
        slices["with spin"].append(metronome(seconds, SPIN))
    return slices


def main() -> None:
    seconds = float(sys.argv[1]) if len(sys.argv) > 1 else 5.0
    rounds = int(sys.argv[2]) if len(sys.argv) > 2 else 4
    if shutil.which("cyclictest") is None:
        raise SystemExit("there is no cyclictest: apt install rt-tests")
    slices = sliced(seconds, rounds)
    middle = {name: [statistics.median(one) for one in zip(*found, strict=True)] for name, found in slices.items()}
    load, kernel = os.getloadavg()[0], os.uname().release
    print(f"{rounds} rounds of {seconds:g} s at {1.0 / PERIOD:.0f} Hz, CPU {CPU}, {kernel}, load {load:.1f}: us late")
    print(f"{'':12}" + "".join(f"{f'p{100 * share:g}':>18}" for share in SHARES))
    for name, found in middle.items():
        ratios = [ours / max(theirs, 1.0) for ours, theirs in zip(found, middle["cyclictest"], strict=True)]
        told = [f"{late:9.1f} ({ratio:5.2f} x)" for late, ratio in zip(found, ratios, strict=True)]
        bounds = WANTED.get(name, (None,) * 3)
        missed = [
            f"p{100 * s:g} must be <= {b} x" for s, b, r in zip(SHARES, bounds, ratios, strict=True) if b and r > b
        ]
        print(f"{name:12}" + "".join(f"{one:>18}" for one in told) + "  " + "; ".join(missed))
    print(f"measured {time.strftime('%Y-%m-%d %H:%M')}; an untuned host unless said otherwise")


if __name__ == "__main__":
    child(float(sys.argv[2]), float(sys.argv[3])) if "-child" in sys.argv else main()
