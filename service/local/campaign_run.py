"""A campaign without a service: in a folder, on worker processes of this machine or on a cluster."""

from __future__ import annotations

from contextlib import closing
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from service.local.campaign_folder import OUTCOMES, SERIES, open_campaign_folder, outcome_of, stored_lines
from service.local.campaign_table import write_table

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from benchmarks.cases import Case, Outcome, Suite
    from service.local.case_runner import Where


class Ended(NamedTuple):
    """How a campaign ended. fresh: insertions of this call; failed: without a result, of all."""

    table: Path
    fresh: int
    failed: int


def run_campaign(
    suite: Suite,
    request: dict[str, Any],
    path: Path,
    where: Where,
    *,
    any_commit: bool = False,
    ended: Callable[[int, int], None] = lambda _done, _of: None,
) -> Ended:
    """Run what a folder does not have yet, and write its table. ended: (insertions in the folder, of so many).

    Raises ScenarioError for a folder of something else.
    """
    fresh = 0
    with open_campaign_folder(path, suite, request, any_commit=any_commit) as folder:
        left = [case for case in suite.cases if case.id not in folder.finished]
        for outcome in _outcomes(left, where, folder.incoming):
            folder.keep(outcome)
            fresh += 1
            ended(len(folder.finished), len(suite.cases))
    failed = sum(not line["result"].get("digest") for line in stored_lines(path))
    return Ended(write_table(path), fresh, failed)


def _outcomes(cases: Sequence[Case], where: Where, folder: Path) -> Iterator[Outcome]:
    if cases:
        with where.runner(folder=folder, files=Path.cwd()) as crew, closing(crew.run_many(cases)) as outcomes:
            yield from outcomes


def outcomes_in(path: Path) -> list[Outcome]:
    """All outcomes of a folder."""
    return [outcome_of(line) for line in stored_lines(path)]


def size_bytes(path: Path) -> tuple[int, int]:
    """What a folder holds: (bytes, files), of lines and series."""
    files = [path / OUTCOMES, *(path / SERIES).rglob("*.npz")]
    return sum(file.stat().st_size for file in files), len(files)
