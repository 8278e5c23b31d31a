"""How far a result on a sequence of grids is from its limit: Richardson's extrapolation and Roache's index.

Roache 1994, Perspective: a method for uniform reporting of grid refinement studies, J. Fluids Eng. 116, 405-413; the
observed order for unequal ratios after Celik et al. 2008, J. Fluids Eng. 130, 078001. A result may be a number or a
curve: (k, m), rows that count alike; its size is the root of the mean square of its rows, and the order is of the curve
as a whole.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    Values = NDArray[np.float64]

SAFETY = 1.25  # on the error of the finest of three grids whose order was observed, Roache
SAFETY_WITHOUT_ORDER = 3.0  # where the order is assumed, Roache
ORDERS = (0.5, 2.0)  # an observed order outside is not believed; linear elements and lumped rows are of at most second
ASSUMED_ORDER = 1.0


@dataclass(frozen=True)
class GridBand:
    """What a sequence of three grids says, in the unit of the result.

    order: observed; None where the results swing or differ by rounding only. finest: of the finest from the limit.
    default: of the middle one. swings: the two changes point away from each other.
    """

    order: float | None
    swings: bool
    finest: float
    default: float


def size_of(values: Values) -> float:
    """Root of the mean square of the rows of a number, (k,) or (k, m)."""
    rows = np.atleast_1d(np.asarray(values, float))
    return float(np.sqrt((rows**2).sum() / len(rows)))


def grid_band(values: Sequence[Values], sizes: Sequence[float]) -> GridBand:
    """Bands from results on three grids, coarse to fine, and their cell sizes.

    A result that swings has no order: its band is the largest difference between any two. Raises ValueError for other
    than three grids, or sizes that do not fall.
    """
    if len(values) != 3 or len(sizes) != 3 or not sizes[0] > sizes[1] > sizes[2] > 0.0:
        raise ValueError(f"sizes {list(sizes)} of {len(values)} results: needs three that fall")
    coarse, default, fine = (np.asarray(value, float) for value in values)
    first, last = default - coarse, fine - default
    most = max(size_of(first), size_of(last), size_of(fine - coarse))
    if size_of(first) == 0.0 or size_of(last) == 0.0:
        return GridBand(None, swings=False, finest=most, default=most)
    if float((first * last).sum()) < 0.0:
        return GridBand(None, swings=True, finest=most, default=most)
    ratios = sizes[0] / sizes[1], sizes[1] / sizes[2]
    order = observed_order(size_of(first) / size_of(last), *ratios)
    believed = ORDERS[0] <= order <= ORDERS[1]
    used, safety = (order, SAFETY) if believed else (ASSUMED_ORDER, SAFETY_WITHOUT_ORDER)
    finest = safety * size_of(last) / (ratios[1] ** used - 1.0)
    return GridBand(order, swings=False, finest=finest, default=size_of(last) + finest)


def observed_order(change_ratio: float, coarse_ratio: float, fine_ratio: float) -> float:
    """Solves (c^p - 1) f^p / (f^p - 1) = change_ratio, c and f the ratios of the grids, coarse and fine for
    p, by halving between -20 and 20, the ends where it lies outside."""
    low, high = -20.0, 20.0
    for _ in range(80):
        p = 0.5 * (low + high)
        smaller = _change_ratio(p, coarse_ratio, fine_ratio) < change_ratio
        low, high = (p, high) if smaller else (low, p)
    return 0.5 * (low + high)


def _change_ratio(p: float, coarse_ratio: float, fine_ratio: float) -> float:
    """Of the changes of A + B h^p from coarse to middle and from middle to fine."""
    if abs(p) < 1e-9:
        return math.log(coarse_ratio) / math.log(fine_ratio)
    return float(math.expm1(p * math.log(coarse_ratio)) * fine_ratio**p / math.expm1(p * math.log(fine_ratio)))
