"""How wide a cylinder a line of balls is like: apart from `line`, so that scenarios are checked without its kernels."""

from __future__ import annotations

LINE_RADIUS_OF_BALL = 0.5119  # b / rho: a line of balls of radius rho gives way like a cylinder of this radius


def smallest_ball_radius(needle_radius: float) -> float:
    """Of the balls that are like a cylinder of the needle's radius, in its unit; theirs must be above it."""
    return needle_radius / LINE_RADIUS_OF_BALL
