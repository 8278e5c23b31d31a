"""A cluster worker whose process is ready at once: for runners of the tests, which compile nothing."""

from __future__ import annotations

import sys

from service.blas_threads import one_thread
from service.cluster.address import ClusterAddress
from service.cluster.processes import WorkerOptions, work

RUNNER = "tests.service.cluster.runners:insertion"

if __name__ == "__main__":
    one_thread()
    work(ClusterAddress(sys.argv[1]), WorkerOptions(patience_s=600.0, runner=RUNNER))
