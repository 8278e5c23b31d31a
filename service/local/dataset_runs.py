"""Many insertions for a data set, on worker processes or a cluster; what is finished outlives an interruption."""

from __future__ import annotations

import hashlib
import json
import zipfile
from contextlib import closing
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from benchmarks.learning.training_insertions import Insertion
from service.worker.crew import CRASHED
from simcore.compiled import fingerprint
from simcore.rollout.artefacts import replace_atomically
from simcore.rollout.dataset import VARIABLES, DatasetError, table_one

if TYPE_CHECKING:
    from collections.abc import Generator, Sequence

    from benchmarks.cases import Case, Outcome
    from service.local.case_runner import Where


class InsertionCache:
    """Finished insertions in a folder, one file each, named by scenario and code: an interrupted run goes on."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def _file(self, case: Case) -> Path:
        content = json.dumps([case.scenario, fingerprint()], sort_keys=True)
        return self.folder / f"{hashlib.sha256(content.encode()).hexdigest()}.npz"

    def find(self, case: Case) -> Insertion | None:
        """The insertion, if it was run before with the same code."""
        try:
            with np.load(self._file(case), allow_pickle=False) as file:
                table = {name: file[name] for name in VARIABLES}
                return Insertion(case, table, str(file["status"]), str(file["digest"]))
        except (OSError, KeyError, ValueError, EOFError, zipfile.BadZipFile):
            return None

    def collect(self, outcome: Outcome) -> Insertion:
        """What a worker has just finished; its series, of which only table I is wanted, is removed."""
        case, result = outcome.case, outcome.result
        if result["status"] == CRASHED:
            raise DatasetError(f"{case.id}: {result['message']}")
        series = self.folder / f"{case.id}.npz"
        with np.load(series, allow_pickle=False) as file:
            table = table_one(file)
        series.unlink()
        return Insertion(case, table, result["status"], result["digest"])

    def keep(self, done: Insertion) -> None:
        """Store one."""
        self.folder.mkdir(parents=True, exist_ok=True)
        texts = {"status": np.array(done.status), "digest": np.array(done.digest)}
        arrays = {**done.table, **texts}
        replace_atomically(self._file(done.case), lambda file: np.savez(file, allow_pickle=False, **arrays))


def insertions(cases: Sequence[Case], *, where: Where, cache: InsertionCache) -> Generator[Insertion, None, None]:
    """Each insertion as soon as it is finished, those in the cache first; one case at a time on each worker.

    Raises DatasetError for an insertion that left no result. Whoever stops asking stops the workers.
    """
    waiting: list[Case] = []
    for case in cases:
        known = cache.find(case)
        if known is not None:
            yield known
        else:
            waiting.append(case)
    cache.folder.mkdir(parents=True, exist_ok=True)
    if not waiting:
        return
    with (
        where.runner(folder=cache.folder, files=Path.cwd()) as crew,
        closing(crew.run_many(waiting)) as outcomes,
    ):
        for outcome in outcomes:
            done = cache.collect(outcome)
            cache.keep(done)
            yield done
