"""Where many insertions run: worker processes of this machine, or a cluster."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

from service.worker.crew import Crew

if TYPE_CHECKING:
    from contextlib import AbstractContextManager
    from pathlib import Path

    from service.cluster.address import ClusterAddress
    from service.worker.crew import CaseRunner


class Where(NamedTuple):
    """workers: processes of this machine, unless there is a cluster."""

    workers: int
    cluster: ClusterAddress | None = None

    def runner(self, *, folder: Path, files: Path) -> AbstractContextManager[CaseRunner]:
        """What runs the cases. folder: for their series; files: in which the names of files in scenarios are looked up;
        on a cluster both are on the shared disk."""
        if self.cluster is None:
            return Crew(self.workers, folder=folder, files=files)
        from service.cluster.crew import ClusterCrew

        return ClusterCrew(self.cluster, folder=folder, files=files)
