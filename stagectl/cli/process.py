"""What this process is made of, said before its heavy modules are imported."""

from __future__ import annotations

import os


def without_compiler() -> None:
    """Interpreted kernels: nothing is simulated here, so no compiler need be in memory."""
    os.environ["STAGECTL_KERNELS"] = "interpreted"


def single_threaded_algebra() -> None:
    """One thread for each product of matrices: our own threads use all cores, and narrow matrices gain nothing."""
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
