"""The bands of the discretisation that claims are held against: of one controller's RMSE, and of the difference of two.

Measured in closed loop by `needlebench bench convergence` on the discretisation of the full scales; for any other they
are unknown unless the scale names them.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from benchmarks.paper.table import ALL, GROUPS, QUIET_ARM, arm_name

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from benchmarks.paper.scale import ExperimentScale

AXIS_ARM = "ifem-axis"  # I-FEM with the axis through the entry, measured beside its rows
STANDS_FOR = {QUIET_ARM: "elm"}  # the same controller with other weights
NAMES = {AXIS_ARM: "I-FEM, axis"}


@dataclass(frozen=True)
class Band:
    """One band. mm: None = unknown. of: what it is the band of, in words."""

    mm: float | None
    of: str

    def __str__(self) -> str:
        return f"{self.of}: {'unknown' if self.mm is None else f'{self.mm:.3g} mm'}"


@dataclass(frozen=True)
class Bands:
    """All that is known of one discretisation. suites: by suite and quantity as convergence.json has them, mm.
    named_mm, named_difference_mm: what a scale names, for all suites and controllers. source: where they are from."""

    suites: Mapping[str, Mapping[str, float | None]] = field(default_factory=dict)
    named_mm: float | None = None
    named_difference_mm: float | None = None
    source: str = "unknown"

    def rmse(self, group: str, *arms: str) -> Band:
        """Of one controller's RMSE; of several, the widest. group: LIN, CUR, or ALL for the wider of both."""
        values = [self._rmse(suite, arm) for suite in _suites(group) for arm in arms]
        return Band(_widest(values), f"RMSE of {' and '.join(map(_name, arms))} on {group}")

    def difference(self, group: str, first: str, second: str) -> Band:
        """Of the paired difference of two controllers. One that was not measured is at most as wide as both RMSEs'
        bands together."""
        values = [self._difference(suite, first, second) for suite in _suites(group)]
        return Band(_widest(values), f"{_name(first)} minus {_name(second)} on {group}")

    def widest_difference(self, group: str, first: str, seconds: Sequence[str]) -> Band:
        """The widest of the differences of one controller from several."""
        found = [self.difference(group, first, second).mm for second in seconds]
        names = " or ".join(map(_name, seconds))
        return Band(_widest(found), f"{_name(first)} minus {names} on {group}, the wider")

    def as_json(self) -> dict[str, Any]:
        """For reports; texts: the same in words, none where nothing is known."""
        named = {"rmse_mm": self.named_mm, "difference_mm": self.named_difference_mm}
        suites = {suite: dict(bands) for suite, bands in self.suites.items()}
        return {"source": self.source, "suites": suites, "named": named, "texts": self._texts()}

    def _texts(self) -> list[str]:
        named = (("RMSE of a controller", self.named_mm), ("differences", self.named_difference_mm))
        texts = [str(Band(mm, of)) for of, mm in named if mm is not None]
        for suite, bands in self.suites.items():
            for quantity, mm in bands.items():
                first, _, second = quantity.partition(" minus ")
                of = (
                    f"{_name(first)} minus {_name(second)} on {suite}"
                    if second
                    else f"RMSE of {_name(first)} on {suite}"
                )
                texts.append(str(Band(mm, of)))
        return texts

    def _rmse(self, suite: str, arm: str) -> float | None:
        if self.named_mm is not None:
            return self.named_mm
        return self.suites.get(suite, {}).get(STANDS_FOR.get(arm, arm))

    def _difference(self, suite: str, first: str, second: str) -> float | None:
        if self.named_difference_mm is not None:
            return self.named_difference_mm
        known = self.suites.get(suite, {})
        for quantity in (f"{first} minus {second}", f"{second} minus {first}"):
            if quantity in known:
                return known[quantity]
        both = [self._rmse(suite, first), self._rmse(suite, second)]
        return None if None in both else sum(value for value in both if value is not None)


UNKNOWN = Bands()
MEASURED_ON = {"element_size_mm": 6.0, "dt_s": 0.01}  # spacing and ball: the defaults, which no scale changes
MEASURED = Bands(
    {
        "LIN": {
            "ifem": 0.000674,
            "ifem-axis": 0.00096,
            "elm": 0.00157,
            "elm minus ifem": 0.00189,
            "elm minus ifem-axis": 0.00196,
        },
        "CUR": {
            "ifem": 0.107,
            "ifem-axis": 0.00495,
            "elm": 0.00388,
            "elm minus ifem": 0.104,
            "elm minus ifem-axis": 0.0056,
        },
    },
    source="needlebench bench convergence, commit 7290a107fe3d",
)


def bands_of(scale: ExperimentScale) -> Bands:
    """What a scale names, and nothing else where it does; else the measured ones, if its discretisation is theirs."""
    if scale.band_mm is not None or scale.band_difference_mm is not None:
        return Bands({}, scale.band_mm, scale.band_difference_mm, "named by the scale")
    same = all(getattr(scale, name) == value for name, value in MEASURED_ON.items())
    return MEASURED if same else UNKNOWN


def _suites(group: str) -> Sequence[str]:
    return GROUPS if group == ALL else (group,)


def _widest(values: Sequence[float | None]) -> float | None:
    known = [value for value in values if value is not None]
    return max(known) if known and len(known) == len(values) else None


def _name(arm: str) -> str:
    return NAMES.get(arm) or arm_name(arm)
