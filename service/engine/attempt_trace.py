"""The way of a running attempt so far, as its progress reported it: for a page that is opened in the middle of it.

Of a job that ended early it is kept in its folder: it is all that there is to plot.
"""

from __future__ import annotations

import json
import logging
from typing import TYPE_CHECKING, Any, NamedTuple

from service.files.replace_text import replace_text

if TYPE_CHECKING:
    from pathlib import Path

    from service.store.job import Job

_log = logging.getLogger(__name__)

COURSE = "course.json"  # in the folder of an attempt that ended early
MOST_POINTS = 1000  # above, every second one is left out; what comes later stays as dense as it is reported


class Point(NamedTuple):
    """Where an attempt was; None for what it does not report."""

    depth_mm: float
    tip_error_mm: float
    cross_track_mm: float | None
    insertion_force_n: float | None


class AttemptTrace:
    """Of the attempt that a slot runs. One thread adds, any may read. Lost with the server, as a running attempt is."""

    def __init__(self) -> None:
        self._attempt: tuple[str, int] | None = None
        self._points: tuple[Point, ...] = ()

    def add(self, job: Job, progress: dict[str, Any]) -> None:
        """One more point; the first of another attempt starts a new trace."""
        attempt = (job.id, job.attempt)
        points = self._points if self._attempt == attempt else ()
        depth_mm, error_mm = progress.get("depth_mm"), progress.get("tip_error_mm")
        if depth_mm is not None and error_mm is not None:
            point = Point(depth_mm, error_mm, progress.get("cross_track_mm"), progress.get("insertion_force_n"))
            points = (*points, point)
        if len(points) > MOST_POINTS:
            points = (*points[:-1:2], points[-1])
        self._attempt, self._points = attempt, points

    def points_of(self, job: Job) -> tuple[Point, ...]:
        """The points of this attempt, none of another."""
        points = self._points
        return points if self._attempt == (job.id, job.attempt) else ()

    def keep(self, job: Job, folder: Path) -> None:
        """Write it into the folder of its attempt. Where that cannot be, it is logged: nothing hangs on a plot."""
        if not (points := self.points_of(job)) or not folder.is_dir():
            return
        try:
            replace_text(folder / COURSE, json.dumps(points, allow_nan=False))
        except (OSError, ValueError) as error:
            _log.warning("job %s: its course is not kept: %s", job.id, error)


def kept_course(folder: Path) -> tuple[Point, ...]:
    """What `keep` wrote there; nothing where it did not, or somebody else changed it."""
    try:
        return tuple(Point(*point) for point in json.loads((folder / COURSE).read_text(encoding="utf-8")))
    except (OSError, ValueError, TypeError):
        return ()
