"""The still picture of an insertion: the body's box, what of it is held, the way that was asked for, the way of the
tip, and the needle at the end. The page draws it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from service.files.series_formats import DamagedSeriesError, load

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from numpy.typing import NDArray

POINTS = 150  # of a way; more are not told apart in a picture


def still(scenario: Mapping[str, Any], faces: list[str], series: Path) -> dict[str, Any] | None:
    """What is drawn of a finished insertion, in mm; None where its series cannot be read.

    origin, size: of the box around the body at rest. path, tip: ways of the target and the tip. shaft: the needle's
    axis at the end. faces, regions: those that were held.
    """
    try:
        arrays = load(series, ["target_m", "tip_m", "shaft_m", "tissue_rest_m"])
    except (DamagedSeriesError, ValueError, OSError):
        return None
    rest = arrays["tissue_rest_m"]
    low, high = rest.min(axis=0), rest.max(axis=0)
    return {
        "origin": _mm(low),
        "size": _mm(high - low),
        "path": _mm(_thinned(arrays["target_m"])),
        "tip": _mm(_thinned(arrays["tip_m"])),
        "shaft": _mm(arrays["shaft_m"][-1]),
        "faces": faces,
        "regions": scenario["tissue"].get("fixed_regions") or [],
        "mesh": scenario["tissue"].get("mesh_file") is not None,
    }


def _thinned(way: NDArray[Any]) -> NDArray[Any]:
    rows = np.unique(np.linspace(0, len(way) - 1, POINTS).round().astype(int))
    kept: NDArray[Any] = way[rows][np.isfinite(way[rows]).all(axis=1)]
    return kept


def _mm(metres: NDArray[Any]) -> list[Any]:
    found: list[Any] = np.round(1e3 * metres, 3).tolist()
    return found
