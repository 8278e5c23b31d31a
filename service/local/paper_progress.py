"""How far an experiment is: a bar with the time left on a terminal, lines elsewhere."""

from __future__ import annotations

import sys
import time
from contextlib import contextmanager
from typing import TYPE_CHECKING

import click

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from rich.progress import Progress

    from benchmarks.cases import Outcome
    from benchmarks.paper.plan import Stage, StagedPlan, StepCost
    from service.local.paper_run import ProgressListener

LINE_EVERY_S = 20.0  # of a progress that goes to no terminal
PACE_OVER_S = 120.0


def minutes(seconds: float) -> str:
    """A time for people."""
    return f"{seconds / 60:.1f} min" if seconds >= 60 else f"{seconds:.0f} s"


@contextmanager
def progress_on(
    plan: StagedPlan, cost: StepCost, workers: int, *, stored: Callable[[str], bool]
) -> Iterator[ProgressListener]:
    """A bar with the time left on a terminal, else lines. stored: whether a case, by its id, was run before."""
    share = {
        case.id: 0.0 if stored(case.id) else cost.of(case) / (1 if stage.alone else workers)
        for stage in plan.stages
        for case in stage.cases
    }
    if not sys.stderr.isatty():
        yield Lines(share)
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeRemainingColumn

    columns = (TextColumn("{task.description}"), BarColumn(), TaskProgressColumn(), TimeRemainingColumn())
    console = Console(stderr=True)
    with Progress(*columns, console=console, speed_estimate_period=PACE_OVER_S) as progress:
        yield Bar(progress, share)


class Lines:
    """Progress that goes to a file or a pipe: a line now and then. share: estimated seconds of each case by id, 0 if it
    was run before."""

    def __init__(self, share: dict[str, float], *, clock: Callable[[], float] = time.monotonic) -> None:
        self._share, self._total, self._done, self._clock = share, sum(share.values()), 0.0, clock
        self._stage, self._count, self._ended = "", 0, 0
        self._begun = self._spoken = clock()

    def begin(self, stage: Stage) -> None:
        """A line for the stage."""
        self._stage, self._count, self._ended = stage.title, len(stage.cases), 0
        click.echo(f"{stage.title}: {len(stage.cases)} insertions", err=True)

    def ended(self, outcome: Outcome) -> None:
        """A line now and then."""
        self._ended += 1
        self._done += self._share.get(outcome.case.id, 0.0)
        now = self._clock()
        if now - self._spoken < LINE_EVERY_S and self._ended < self._count:
            return
        self._spoken = now
        click.echo(f"{self._stage}: {self._ended} of {self._count}{self._left(now)}", err=True)

    def _left(self, now: float) -> str:
        """At the pace since the beginning, once there is one."""
        if not self._done:
            return ""
        left = (self._total - self._done) / self._done * (now - self._begun)
        return f"; {100 * self._done / self._total:.0f} %, about {minutes(left)} left"

    def say(self, text: str) -> None:
        """The text."""
        click.echo(text, err=True)


class Bar:
    """Progress on a terminal, measured in estimated seconds, so that dear insertions count more."""

    def __init__(self, progress: Progress, share: dict[str, float]) -> None:
        self._progress, self._share = progress, share
        self._task = progress.add_task("starting", total=sum(share.values()))
        self._count, self._ended, self._title = 0, 0, ""

    def begin(self, stage: Stage) -> None:
        """Name the stage beside the bar."""
        self._title, self._count, self._ended = stage.title, len(stage.cases), 0
        self._progress.update(self._task, description=f"{stage.title} 0/{self._count}")

    def ended(self, outcome: Outcome) -> None:
        """Move the bar by the estimated seconds of the insertion."""
        self._ended += 1
        done = self._share.get(outcome.case.id, 0.0)
        self._progress.update(self._task, advance=done, description=f"{self._title} {self._ended}/{self._count}")

    def say(self, text: str) -> None:
        """The text, above the bar."""
        self._progress.console.print(text, highlight=False, markup=False)
