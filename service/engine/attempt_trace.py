"""The way of a running attempt so far, as it was told: what a page draws that is opened in the middle of it."""

from __future__ import annotations

from typing import Any, NamedTuple

from service.store.job import Job

MOST_POINTS = 1000  # above, every second one is left out; what comes later stays as dense as it is told


class Point(NamedTuple):
    """Where an attempt was; None for what it does not tell."""

    depth_mm: float
    tip_error_mm: float
    cross_track_mm: float | None
    insertion_force_n: float | None


class Course:
    """Of the attempt that a slot sees through. One thread adds, any may read; lost with the server, as the attempt."""

    def __init__(self) -> None:
        self._of: tuple[str, int] | None = None
        self._points: tuple[Point, ...] = ()

    def add(self, job: Job, told: dict[str, Any]) -> None:
        """One more point; another attempt begins anew."""
        whose = (job.id, job.attempt)
        points = self._points if self._of == whose else ()
        depth_mm, error_mm = told.get("depth_mm"), told.get("tip_error_mm")
        if depth_mm is not None and error_mm is not None:
            points = (*points, Point(depth_mm, error_mm, told.get("cross_track_mm"), told.get("insertion_force_n")))
        if len(points) > MOST_POINTS:
            points = (*points[:-1:2], points[-1])
        self._of, self._points = whose, points

    def of(self, job: Job) -> tuple[Point, ...]:
        """The points of this attempt, none of another."""
        points = self._points
        return points if self._of == (job.id, job.attempt) else ()
