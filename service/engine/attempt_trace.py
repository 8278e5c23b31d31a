"""The way of a running attempt so far, as its progress reported it: for a page that is opened in the middle of it."""

from __future__ import annotations

from typing import Any, NamedTuple

from service.store.job import Job

MOST_POINTS = 1000  # above, every second one is left out; what comes later stays as dense as it is reported


class Point(NamedTuple):
    """Where an attempt was; None for what it does not report."""

    depth_mm: float
    tip_error_mm: float
    cross_track_mm: float | None
    insertion_force_n: float | None


class AttemptTrace:
    """Of the attempt that a slot runs. One thread adds, any may read; lost with the server, as the attempt is."""

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
