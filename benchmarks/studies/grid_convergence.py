"""How far a result on a sequence of grids is from its limit: Richardson's extrapolation and Roache's index.

Roache 1994, Perspective: a method for uniform reporting of grid refinement studies, J. Fluids Eng. 116, 405-413; the
observed order for unequal ratios after Celik et al. 2008, J. Fluids Eng. 130, 078001. A result may be a number or a
curve: (k, m), rows that count alike; its size is the root of the mean square of its rows, and the order is of the curve
as a whole.

Where no order is believed there are two rules. `grid_band` has Roache's assumed order, and where results swing their
range. `ranged_band` has three times their range in both cases: Eca and Hoekstra 2008, The numerical friction line,
J. Mar. Sci. Technol. 13, 328-345, appendix 1, where convergence is not monotonic. Their procedure of 2014
(J. Comput. Phys. 262, 104-130), which replaces it by least-squares fits, needs four grids.
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
RANGE_SAFETY = 3.0  # on the range of results without an order, Eca and Hoekstra


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
    """Roache's bands from results on three grids, coarse to fine, and their cell sizes.

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


def ranged_band(values: Sequence[Values], sizes: Sequence[float]) -> GridBand:
    """`grid_band` where it believes an observed order, else RANGE_SAFETY times the largest difference between any two.
    For results that may scatter. Raises ValueError as it does."""
    found = grid_band(values, sizes)
    if found.order is not None and ORDERS[0] <= found.order <= ORDERS[1]:
        return found
    wide = RANGE_SAFETY * _range(values)
    return GridBand(found.order, found.swings, finest=wide, default=wide)


def two_grid_band(values: Sequence[Values], sizes: Sequence[float]) -> GridBand:
    """Of two grids, coarse (the default) to fine, which show no order: RANGE_SAFETY times their difference. Raises
    ValueError for other than two, or sizes that do not fall."""
    if len(values) != 2 or len(sizes) != 2 or not sizes[0] > sizes[1] > 0.0:
        raise ValueError(f"sizes {list(sizes)} of {len(values)} results: needs two that fall")
    wide = RANGE_SAFETY * _range(values)
    return GridBand(None, swings=False, finest=wide, default=wide)


def _range(values: Sequence[Values]) -> float:
    results = [np.asarray(value, float) for value in values]
    return max(size_of(one - other) for one in results for other in results)


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
