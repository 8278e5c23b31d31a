"""The plots of a recording: their series, and the numbers of a step."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

from service.recording.colors import CYAN, GREEN, ORANGE, RED, YELLOW

if TYPE_CHECKING:
    from collections.abc import Callable

    from simcore.rollout.records import StepRecord


class Moment(NamedTuple):
    """The vectors of a record that its plots compare, as lists: math on three numbers is slow on arrays."""

    position_m: list[float]  # (3,) of the base
    rotation: list[float]  # (4,) of the base
    tip_m: list[float]  # (3,)
    target_m: list[float]  # (3,)
    command_m: list[float]  # (3,) of the base as commanded

    @classmethod
    def of(cls, r: StepRecord) -> Moment:
        """A copy of what a record holds."""
        vectors = r.base_position_m, r.base_rotation, r.tip_m, r.target_m, r.command_position_m
        return cls(*(vector.tolist() for vector in vectors))


class Step(NamedTuple):
    """One step as the plots see it. before: the moment of the previous step; of the first step its own."""

    record: StepRecord
    now: Moment
    before: Moment
    dt_s: float


@dataclass(frozen=True)
class Plot:
    """One entity with one or more series; `values` gives one number per series."""

    entity: str
    series: tuple[tuple[str, tuple[int, int, int]], ...]  # name with its unit, colour
    values: Callable[[Step], tuple[float, ...]]


def _errors(step: Step) -> tuple[float, ...]:
    """The tip against the target that its command aimed at: the definition behind rmse_commanded_mm."""
    return 1e3 * math.dist(step.now.tip_m, step.before.target_m), 1e3 * step.record.rcm_error_m


def _depth(step: Step) -> tuple[float, ...]:
    return (1e3 * step.record.depth_m,)


def _tissue(step: Step) -> tuple[float, ...]:
    return (1e3 * step.record.max_displacement_m,)


def _forces(step: Step) -> tuple[float, ...]:
    lateral = float(step.record.base_force_n @ step.record.base_force_n) - step.record.insertion_force_n**2
    return step.record.insertion_force_n, math.sqrt(max(0.0, lateral))


def _command(step: Step) -> tuple[float, ...]:
    commanded = math.dist(step.now.command_m, step.before.position_m) / step.dt_s
    actual = math.dist(step.now.position_m, step.before.position_m) / step.dt_s
    opposite = [-component for component in step.before.rotation]  # the same rotation
    half = 0.5 * min(math.dist(step.now.rotation, step.before.rotation), math.dist(step.now.rotation, opposite))
    return (
        1e3 * commanded,
        1e3 * actual,
        math.degrees(4 * math.asin(min(1.0, half))) / step.dt_s,
        float(step.record.limited),
    )


def _solver(step: Step) -> tuple[float, ...]:
    return float(step.record.iterations), math.log10(max(step.record.residual_n, 1e-16))


def _timing(step: Step) -> tuple[float, ...]:
    return 1e3 * step.record.timing.plant_s, 1e3 * step.record.timing.jacobian_s, 1e3 * step.record.timing.command_s


PLOTS = (
    Plot("metrics/error", (("tip error, mm", ORANGE), ("shaft to entry, mm", CYAN)), _errors),
    Plot("metrics/forces", (("insertion, N", ORANGE), ("lateral at the base, N", CYAN)), _forces),
    Plot("metrics/tissue", (("largest tissue displacement, mm", YELLOW),), _tissue),
    Plot("metrics/depth", (("inserted, mm", GREEN),), _depth),
    Plot(
        "metrics/command",
        (
            ("commanded speed, mm/s", ORANGE),
            ("speed, mm/s", GREEN),
            ("rotation, deg/s", CYAN),
            ("limited, 1 = yes", RED),
        ),
        _command,
    ),
    Plot("metrics/solver", (("iterations", GREEN), ("log10 of the residual, N", CYAN)), _solver),
    Plot("timing/step", (("plant, ms", ORANGE), ("Jacobian, ms", CYAN), ("command, ms", GREEN)), _timing),
)
