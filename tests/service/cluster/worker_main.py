"""A cluster worker whose process is ready at once: for runners of the tests, which compile nothing.

ADDRESS [--lifetime SECONDS] [--commit COMMIT]     the commit that it says it runs
"""

from __future__ import annotations

import argparse

from service.blas_threads import one_thread
from service.cluster import identity
from service.cluster.address import ClusterAddress
from service.cluster.processes import WorkerOptions, work

RUNNER = "tests.service.cluster.runners:insertion"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--lifetime", type=float)
    parser.add_argument("--commit")
    parser.add_argument("address")
    given = parser.parse_args()
    if given.commit is not None:
        other = {**identity.identity(), "commit": given.commit}
        identity._identity = lambda: other  # type: ignore[assignment]
    one_thread()
    work(ClusterAddress(given.address), WorkerOptions(patience_s=600.0, lifetime_s=given.lifetime, runner=RUNNER))


if __name__ == "__main__":
    main()
