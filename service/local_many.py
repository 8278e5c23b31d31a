"""Many insertions for a data set, on worker processes of this machine; what is finished outlives an interruption."""

from __future__ import annotations

import hashlib
import json
import zipfile
from collections.abc import Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, wait
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from benchmarks.dataset import Insertion
from benchmarks.paper.records import Case
from service import pool
from simcore.artefacts import replace_atomically
from simcore.compiled import fingerprint
from simcore.dataset import VARIABLES

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Answer = tuple[dict[str, NDArray[np.float64]], str, str]


def warm_up() -> None:
    """In a worker: compile every kernel, or load it from the cache."""
    from simcore.rollout import compile_kernels

    compile_kernels()


def table_of(scenario: dict[str, Any]) -> Answer:
    """In a worker: run a scenario; its table I, its status and its digest."""
    from simcore.dataset import table_one
    from simcore.rollout import run
    from simcore.scenario import Scenario

    done = run(Scenario.load(scenario))
    return table_one(done.series), str(done.status), done.digest


class Kept:
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

    def keep(self, done: Insertion) -> None:
        """Store one."""
        self.folder.mkdir(parents=True, exist_ok=True)
        texts = {"status": np.array(done.status), "digest": np.array(done.digest)}
        arrays = {**done.table, **texts}
        replace_atomically(self._file(done.case), lambda file: np.savez(file, allow_pickle=False, **arrays))


def insertions(cases: Sequence[Case], *, workers: int, kept: Kept) -> Iterator[Insertion]:
    """Each insertion as soon as it is finished, those that were kept first; one case at a time on each worker.

    Raises what an insertion raised. Whoever stops asking stops the workers.
    """
    waiting: list[Case] = []
    for case in cases:
        known = kept.find(case)
        if known is not None:
            yield known
        else:
            waiting.append(case)
    with ExitStack() as stack:
        staff = [pool.Worker() for _ in range(min(workers, len(waiting)))]
        for worker in staff:
            stack.callback(worker.stop)
        lock = str(kept.folder / "warm.lock")
        for worker in staff:
            worker.call(pool.warm, "service.local_many:table_of", lock).result()
        for case, answer in _answers(staff, waiting):
            done = Insertion(case, *answer)
            kept.keep(done)
            yield done


def _answers(staff: list[pool.Worker], cases: list[Case]) -> Iterator[tuple[Case, Answer]]:
    left = iter(cases)
    running: dict[Future[Any], tuple[pool.Worker, Case]] = {}

    def next_for(worker: pool.Worker) -> None:
        case = next(left, None)
        if case is not None:
            running[worker.call(table_of, case.scenario)] = worker, case

    for worker in staff:
        next_for(worker)
    while running:
        for future in wait(running, return_when=FIRST_COMPLETED).done:
            worker, case = running.pop(future)
            answer = pool.answer(future)
            next_for(worker)
            yield case, answer
