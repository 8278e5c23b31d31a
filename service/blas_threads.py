"""One thread for every numeric library. To be applied before numpy is imported for the first time."""

from __future__ import annotations

import os

THREAD_VARIABLES = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")


def one_thread() -> None:
    """One thread for this process and all that it starts: two jobs side by side must not fight over the cores."""
    for name in THREAD_VARIABLES:
        os.environ[name] = "1"
