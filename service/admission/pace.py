"""How the wall time of insertions on this machine compares with the estimates of `cost`, by the latest ones."""

from __future__ import annotations

import threading
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from service.admission.admission import names_mesh
from service.admission.cost import cost_of
from simcore.errors import ScenarioError
from simcore.scenario.scenario import Scenario

if TYPE_CHECKING:
    from collections.abc import Sequence

    from service.store.jobs import Store

LATEST = 20  # insertions that are looked at
BAND = (10.0, 90.0)  # percentiles of their ratios
LEAST_SPREAD = 1.25  # to each side, however alike they were
UNMEASURED_SPREAD = 2.5  # to each side, of an estimate that nothing was compared with


@dataclass(frozen=True, kw_only=True)
class Pace:
    """Wall time over estimate: low and high end of a band, and its middle. insertions: that it was measured on."""

    low: float
    middle: float
    high: float
    insertions: int

    def seconds(self, estimate_s: float) -> tuple[float, float, float]:
        """Least, most likely and most wall time of what is estimated to take so long."""
        return self.low * estimate_s, self.middle * estimate_s, self.high * estimate_s


def pace_of(ratios: Sequence[float]) -> Pace:
    """The pace of insertions by their ratios of wall time to estimate; that of the estimate itself without any."""
    if not ratios:
        return Pace(low=1.0 / UNMEASURED_SPREAD, middle=1.0, high=UNMEASURED_SPREAD, insertions=0)
    low, middle, high = (float(value) for value in np.percentile(ratios, [BAND[0], 50.0, BAND[1]]))
    return Pace(
        low=min(low, middle / LEAST_SPREAD),
        middle=middle,
        high=max(high, middle * LEAST_SPREAD),
        insertions=len(ratios),
    )


class PaceMeter:
    """Reads the pace from the store. An insertion is looked at once; those in meshes from files are passed over, since
    no mesh is read in the server."""

    def __init__(self, store: Store) -> None:
        self._store = store
        self._ratios: dict[str, float | None] = {}  # by id of a job
        self._lock = threading.Lock()

    def pace(self) -> Pace:
        """Of the latest insertions that finished."""
        latest = self._store.latest_finished(LATEST)
        with self._lock:
            known = self._ratios
            self._ratios = {one: known[one] if one in known else self._ratio(one, wall_s) for one, wall_s in latest}
            return pace_of([ratio for ratio in self._ratios.values() if ratio is not None])

    def _ratio(self, job_id: str, wall_s: float) -> float | None:
        scenario = ((self._store.get(job_id)).spec or {}).get("scenario")
        if scenario is None or names_mesh(scenario):
            return None
        try:
            return wall_s / cost_of(Scenario.load(scenario)).time_s
        except ScenarioError:  # a file that it names is gone
            return None
