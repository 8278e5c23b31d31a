"""How the tip is seen, field by field, and the rules between these fields; tags of the defaults as in `blocks`."""

from __future__ import annotations

from typing import Any, Literal

from pydantic import Field

from simcore.errors import Problem
from simcore.scenario.blocks import Block, Number, bounded


class Sensing(Block):
    """Images of the tip, for every controller alike. A path in the tissue frame is seen in the same images; pose and
    wrench of the base are the robot's own and always of the moment."""

    rate_hz: Number | None = Field(
        default=None,
        ge=0.1,
        le=10_000.0,
        description="images per s, 0.1 to 10000, a whole number of steps apart; between two the last one stays; null = "
        "one every step [ours]",
    )
    latency_s: Number = bounded(
        0.0, 0.0, 1.0, "s from the taking of an image to its being seen, a multiple of dt_s [ours]"
    )
    noise_mm: Number = bounded(
        0.0, 0.0, 5.0, "standard deviation of the tip in an image, normal, per axis, drawn for each image [ours]"
    )
    tip: Literal["true", "registered"] = Field(
        default="true",
        description="true = images are in the robot's frame, registered = the tip in them is shifted by one offset for "
        "the whole run, drawn from the seed [ours]",
    )
    registration_mm: Number = bounded(
        1.0, 0.0, 20.0, "standard deviation of that offset, normal, per axis; with tip = registered alone [ours]"
    )

    def steps(self, dt_s: float) -> tuple[int, int]:
        """Between two images, and from an image to its being seen."""
        period = 1 if self.rate_hz is None else max(1, round(1.0 / (self.rate_hz * dt_s)))
        return period, round(self.latency_s / dt_s)

    @property
    def degrades(self) -> bool:
        """Whether the tip is seen otherwise than it is."""
        return (self.rate_hz, self.latency_s, self.noise_mm, self.tip) != (None, 0.0, 0.0, "true")


def without_idle_sensing(resolved: dict[str, Any]) -> dict[str, Any]:
    """Resolved scenario JSON without a `sensing` block that changes nothing: what is run is then the same as of a
    scenario from before there was one."""
    block = resolved.get("sensing")
    idle = isinstance(block, dict) and not Sensing.model_validate(block).degrades
    return {key: value for key, value in resolved.items() if key != "sensing"} if idle else resolved


def sensing_problems(sensing: Sensing, dt_s: float) -> list[Problem]:
    """Images that are not a whole number of steps apart, or not seen a whole number of steps later."""
    (period, latency), problems = sensing.steps(dt_s), list[Problem]()
    if sensing.rate_hz is not None and abs(1.0 / sensing.rate_hz - period * dt_s) > 1e-6 * dt_s:
        fits = " and ".join(f"{1.0 / (count * dt_s):.6g}" for count in (period + 1, period))
        allowed = f"must divide 1 / dt_s = {1.0 / dt_s:.6g} Hz; {fits} do"
        problems.append(Problem("sensing.rate_hz", sensing.rate_hz, allowed))
    if abs(sensing.latency_s - latency * dt_s) > 1e-6 * dt_s:
        allowed = f"must be a multiple of dt_s = {dt_s:g} s, from 0 to 1 s; the nearest is {latency * dt_s:g}"
        problems.append(Problem("sensing.latency_s", sensing.latency_s, allowed))
    return problems
