"""Integration tests on a real vcan0, a real systemd and a PREEMPT_RT kernel, in a machine of their own.

    python tools/vm                      build what is not built, boot what is not booted, run tests/vm
    python tools/vm tests/vm/test_bus.py -x

Exit code 0: passed, or skipped with the reason; 1: failed; 75: no verdict, as the host had no time for it.
$STAGECTL_VM_PATIENCE: seconds for all of it; $STAGECTL_VM_RESULTS: folder for journal and figures.
"""

import os
import sys
import time
from pathlib import Path

import image
import machine
import needs

PATIENCE = 3600.0  # s: all tests take a processor of their own some 20 minutes
NO_VERDICT = 75  # EX_TEMPFAIL


def main(arguments: list[str]) -> int:
    end = time.monotonic() + float(os.environ.get("STAGECTL_VM_PATIENCE") or PATIENCE)
    try:
        needs.present()
        built = _frozen(end)
        results = Path(os.environ.get("STAGECTL_VM_RESULTS") or built.parent / "results")
        results.mkdir(parents=True, exist_ok=True)
        began = time.monotonic()
        ended = machine.run(built, arguments or ["tests/vm"], end - began, results)
    except needs.SkipError as reason:
        return _told(f"skipped: {reason}", 0)
    except machine.StarvedError as reason:
        return _told(f"no verdict: {reason}", NO_VERDICT)
    except machine.LateError as reason:
        return _told(f"FAILED: {reason}", 1)
    if not ended.passed and ended.results is not None:
        _show(ended.results)
    took = f"{time.monotonic() - began:.0f} s"
    if not ended.passed:
        return _told(f"FAILED: {ended.why}, {took}", 1)
    figures = results / "figures.txt"
    print(figures.read_text() if figures.exists() else "", end="")
    return _told(f"passed, {took}", 0)


def _frozen(end: float) -> Path:
    """The folder of a guest that has booted."""
    began = time.monotonic()
    built = image.image()
    if not (built / machine.FROZEN).exists():
        machine.boot(built, end - time.monotonic())
    print(f"tools/vm: machine {built.name} after {time.monotonic() - began:.0f} s", flush=True)
    return built


def _told(words: str, code: int) -> int:
    print(f"tools/vm: {words}", flush=True)
    return code


def _show(results: Path) -> None:
    """The end of the guest's journal, and where all of it is."""
    journal = results / "journal.txt"
    if journal.exists():
        print(f"--- the last lines of {journal}", *journal.read_text(errors="replace").splitlines()[-60:], sep="\n")


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
