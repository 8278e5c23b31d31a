"""The discretisations of the convergence study: the default, and what is varied around it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

LOOP_DT_S = 0.01  # of closed loops: that of the experiments, and of the insertions that a packaged model learnt from
Changes = dict[str, Any]  # of a scenario's blocks


@dataclass(frozen=True)
class Series:
    """Discretisations from coarse to fine. changes: one for each size. default: number of the one that is varied."""

    name: str
    sizes_mm: tuple[float, ...]
    changes: tuple[Changes, ...]
    default: int = 1


@dataclass(frozen=True)
class Discretisation:
    """The default and what is varied around it. dt_s: of the replays."""

    element_size_mm: float
    spacing_mm: float
    dt_s: float
    sizes_mm: tuple[float, float, float]
    spacings_mm: tuple[float, float, float]
    balls_mm: tuple[float, float]

    def series(self) -> tuple[Series, Series]:
        """Meshes at the default spacing, and spacings on the default mesh; the middle one is the default."""
        meshes = tuple(self._changes(h, self.spacing_mm) for h in self.sizes_mm)
        spacings = tuple(self._changes(self.element_size_mm, s) for s in self.spacings_mm)
        return Series("mesh", self.sizes_mm, meshes), Series("spacing", self.spacings_mm, spacings)

    def loop_series(self) -> tuple[Series, Series, Series]:
        """With the balls over which forces are spread, the first of which is the default."""
        default = self._changes(self.element_size_mm, self.spacing_mm)
        balls = tuple({**default, "interaction": {**default["interaction"], "spread_mm": b}} for b in self.balls_mm)
        return (*self.series(), Series("ball", self.balls_mm, balls, default=0))

    @staticmethod
    def _changes(element_size_mm: float, spacing_mm: float) -> Changes:
        return {"tissue": {"element_size_mm": element_size_mm}, "interaction": {"spacing_mm": spacing_mm}}


FULL = Discretisation(6.0, 3.0, 0.04, (8.0, 6.0, 4.4), (4.5, 3.0, 2.0), (6.0, 4.0))
QUICK = Discretisation(10.0, 5.0, 0.04, (15.0, 10.0, 8.0), (7.5, 5.0, 3.5), (6.0, 4.0))
QUICK_SHARE = 0.12  # of the way to the target
