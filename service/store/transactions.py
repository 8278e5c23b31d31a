"""Transactions on the database, and word of what they changed: what all stores are made of."""

from __future__ import annotations

import threading
import time
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from service.store.database import sync
from service.store.integrity import Mark

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator

    from sqlalchemy import Connection, Engine


class Transactions:
    """Short transactions on one database, one writer at a time.

    now: gives UTC seconds since 1970. `listen` says who hears of each changed job.
    """

    def __init__(self, engine: Engine, *, now: Callable[[], float] = time.time) -> None:
        self._engine = engine
        self._writer = engine.execution_options(write=True)
        self._lazy_writer = engine.execution_options(write="lazy")
        self._turn = threading.Lock()  # writers of this process queue up here and not in SQLite's busy loop
        self._mark = Mark(Path(str(engine.url.database)))
        self._now = now
        self._listeners: tuple[Callable[[str], None], ...] = ()
        self._changed: list[str] = []  # within the transaction of whoever has the turn

    @property
    def engine(self) -> Engine:
        """The database."""
        return self._engine

    def listen(self, *listeners: Callable[[str], None]) -> None:
        """From now on these hear the id of each job that changed, one after the other, once the change can be read."""
        self._listeners = listeners

    def notify(self, *job_ids: str) -> None:
        """Tell who listens that these changed."""
        for job_id in job_ids:
            for listener in self._listeners:
                listener(job_id)

    def changed_within(self, job_ids: Iterable[str]) -> None:
        """Within a transaction that writes: listeners hear of these once it is committed."""
        self._changed.extend(job_ids)

    @property
    def now(self) -> float:
        """UTC seconds since 1970, by the store's clock."""
        return self._now()

    def reading(self) -> AbstractContextManager[Connection]:
        """A transaction that reads, for the stores of other tables."""
        return self._engine.begin()

    def writing(self) -> AbstractContextManager[Connection]:
        """A transaction that writes, for the stores of other tables."""
        return self._write()

    @contextmanager
    def _write(self, *, lazy: bool = False) -> Iterator[Connection]:
        """lazy: do not wait for the disk, as nobody was promised anything yet."""
        with self._turn:
            self._changed = []
            with (self._lazy_writer if lazy else self._writer).begin() as connection:
                yield connection
                count = self._mark.count(connection)
            self._mark.committed = count
            if not lazy:
                self._mark.keep(count)
            changed = self._changed
        self.notify(*changed)

    def _sync(self) -> None:
        """Bring to the disk what was committed so far. Raises OSError."""
        count = self._mark.committed
        sync(self._engine)
        if count:
            self._mark.keep(count)

    def close(self) -> None:
        """Give the connections back."""
        self._engine.dispose()
        self._mark.close()
