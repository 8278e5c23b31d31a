"""How far an experiment is: a bar with the time left on a terminal, lines elsewhere."""

from __future__ import annotations

import sys
import time
from contextlib import contextmanager
from typing import TYPE_CHECKING

import click

if TYPE_CHECKING:
    from collections.abc import Iterator

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
def progress_on(plan: StagedPlan, cost: StepCost, workers: int) -> Iterator[ProgressListener]:
    """A bar with the time left on a terminal, else lines."""
    share = {case.id: cost.of(case) / (1 if stage.alone else workers) for stage in plan.stages for case in stage.cases}
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
    """Progress that goes to a file or a pipe: a line now and then. share: estimated seconds of each case by id."""

    def __init__(self, share: dict[str, float]) -> None:
        self._share, self._total, self._done = share, sum(share.values()), 0.0
        self._stage, self._count, self._ended = "", 0, 0
        self._begun = self._spoken = time.monotonic()
        self._fresh = 0.0

    def begin(self, stage: Stage) -> None:
        """A line for the stage."""
        self._stage, self._count, self._ended = stage.title, len(stage.cases), 0
        click.echo(f"{stage.title}: {len(stage.cases)} insertions", err=True)

    def ended(self, outcome: Outcome, *, fresh: bool) -> None:
        """A line now and then."""
        self._ended += 1
        seconds, now = self._share.get(outcome.case.id, 0.0), time.monotonic()
        self._done += seconds
        self._fresh += seconds if fresh else 0.0
        if now - self._spoken < LINE_EVERY_S and self._ended < self._count:
            return
        self._spoken = now
        pace = (now - self._begun) / self._fresh if self._fresh else 1.0
        left = minutes(pace * max(0.0, self._total - self._done))
        share = f"{100 * self._done / self._total:.0f} %, about {left} left"
        click.echo(f"{self._stage}: {self._ended} of {self._count}; {share}", err=True)

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

    def ended(self, outcome: Outcome, *, fresh: bool) -> None:  # noqa: ARG002  (a listener's signature)
        """Move the bar by the estimated seconds of the insertion."""
        self._ended += 1
        done = self._share.get(outcome.case.id, 0.0)
        self._progress.update(self._task, advance=done, description=f"{self._title} {self._ended}/{self._count}")

    def say(self, text: str) -> None:
        """The text, above the bar."""
        self._progress.console.print(text, highlight=False, markup=False)
