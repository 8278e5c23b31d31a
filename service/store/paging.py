"""Pages of a list that is read newest first."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Generic, Protocol, TypeVar


class Numbered(Protocol):
    """A row of the database. seq: grows with each new one."""

    @property
    def seq(self) -> int:
        """Its number."""


Item = TypeVar("Item")
Row = TypeVar("Row", bound=Numbered)


@dataclass(frozen=True)
class Page(Generic[Item]):
    """Some items, newest first. next_cursor: where the older ones begin; None at the end."""

    items: list[Item]
    next_cursor: str | None


def read_page(newest: Callable[[int, int | None], list[Row]], *, size: int, cursor: str | None) -> Page[Row]:
    """The rows older than the cursor. newest: gives at most so many rows below a number, None = of all."""
    rows = newest(size + 1, int(cursor) if cursor else None)  # one more, to know whether others follow
    items = rows[:size]
    return Page(items, str(items[-1].seq) if len(rows) > size else None)
