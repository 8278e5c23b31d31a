"""Bands of three grids: known errors are covered, orders recovered, what swings is not extrapolated; the study."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING
from xml.etree import ElementTree

import numpy as np
import pytest

from benchmarks.observed_run import ObservedRun
from benchmarks.studies.convergence import PATHS, SUITES, path_bands, path_scenario
from benchmarks.studies.convergence_report import band_part, suite_bands
from benchmarks.studies.discretisation import FULL, LOOP_DT_S, QUICK
from benchmarks.studies.grid_convergence import grid_band, observed_order, ranged_band, size_of, two_grid_band
from tests.benchmarks.studies.loops import made_paths

if TYPE_CHECKING:
    from benchmarks.studies.convergence_report import PathBands

SIZES = (8.0, 6.0, 4.4)


def power_law(order: float, limit: float = 1.0, slope: float = 0.02) -> list[np.ndarray]:
    return [np.array([limit + slope * h**order]) for h in SIZES]


@pytest.mark.parametrize("order", [0.6, 1.0, 1.5, 2.0])
def test_the_order_of_a_power_law_is_found_and_its_error_covered(order: float) -> None:
    values = power_law(order - 1e-9)
    band = grid_band(values, SIZES)
    assert band.order == pytest.approx(order, abs=1e-6)
    true = [abs(float(value[0]) - 1.0) for value in values]
    assert band.finest == pytest.approx(1.25 * true[2], rel=1e-6)
    assert true[1] < band.default < 1.25 * true[1]


@pytest.mark.parametrize("order", [0.1, 4.0])
def test_an_order_that_is_not_believed_gives_a_wide_band(order: float) -> None:
    values = power_law(order)
    band = grid_band(values, SIZES)
    change = abs(float(values[2][0] - values[1][0]))
    assert band.order == pytest.approx(order, abs=1e-5)
    assert band.finest == pytest.approx(3.0 * change / (6.0 / 4.4 - 1.0))


def test_results_that_swing_have_no_order() -> None:
    band = grid_band([np.array([1.0]), np.array([1.4]), np.array([1.3])], SIZES)
    assert (band.order, band.swings) == (None, True)
    assert band.finest == band.default == pytest.approx(0.4)


@pytest.mark.parametrize(
    ("values", "order"), [((1.0, 1.4, 1.3), None), ((1.0, 1.01, 1.4), "low"), ((1.0, 1.39, 1.4), "high")]
)
def test_results_without_an_order_have_three_times_their_range(
    values: tuple[float, float, float], order: str | None
) -> None:
    """Whether they swing, run away or come to rest too soon: 0.4 mm between any two, 1.2 mm."""
    band = ranged_band([np.array([value]) for value in values], SIZES)
    assert band.finest == band.default == pytest.approx(1.2)
    assert band.swings is (order is None)
    assert (band.order is None) is band.swings


@pytest.mark.parametrize("order", [0.6, 1.0, 1.9])
def test_an_order_that_is_believed_has_roaches_band(order: float) -> None:
    values = power_law(order)
    assert ranged_band(values, SIZES) == grid_band(values, SIZES)


def test_two_grids_show_no_order() -> None:
    band = two_grid_band([np.array([0.05]), np.array([0.04])], (6.0, 4.0))
    assert (band.order, band.finest) == (None, band.default)
    assert band.default == pytest.approx(0.03)
    with pytest.raises(ValueError, match="two that fall"):
        two_grid_band([np.ones(1)] * 2, (4.0, 6.0))
    with pytest.raises(ValueError, match="two that fall"):
        two_grid_band([np.ones(1)] * 3, (6.0, 4.0, 3.0))


def test_equal_results_have_no_band() -> None:
    assert grid_band([np.ones((4, 3))] * 3, SIZES).default == 0.0


def test_a_curve_counts_as_a_whole() -> None:
    """Rows whose own changes swing do not, when the curve as a whole does not."""
    shape = np.array([[1.0, 0.0, 0.0], [0.0, 2.0, 0.0], [0.0, 0.0, -1.0]])
    values = [h * shape for h in SIZES]
    values[1] = values[1] + np.array([[0.0, 0.0, 0.01], [0.0, 0.0, 0.0], [0.0, 0.0, 0.0]])
    band = grid_band(values, SIZES)
    assert not band.swings
    assert band.order == pytest.approx(1.0, abs=0.05)
    assert size_of(shape) == pytest.approx(np.sqrt(2.0))


@pytest.mark.parametrize("sizes", [(6.0, 8.0, 4.4), (8.0, 6.0), (8.0, 6.0, 0.0)])
def test_grids_that_do_not_fall_are_refused(sizes: tuple[float, ...]) -> None:
    with pytest.raises(ValueError, match="three that fall"):
        grid_band([np.ones(1)] * 3, sizes)


def test_equal_changes_on_unequal_grids_have_their_order() -> None:
    ratio = (8.0 - 6.0) / (6.0 - 4.4)
    assert observed_order(ratio, 8 / 6, 6 / 4.4) == pytest.approx(1.0, abs=1e-9)


# ---- the study


def made_run(offset_mm: float, force_n: float, seconds: float = 3.0) -> ObservedRun:
    t = np.linspace(0.0, seconds, 76)
    tip = np.column_stack([1e-4 * offset_mm * t, 0 * t, 0.01 * t])
    series = {"t_s": t, "tip_m": tip, "entry_force_n": force_n * t, "insertion_force_n": 1.0 + 0 * t}
    return ObservedRun("completed", "", {}, {}, series)


def made_bands(name: str, steepness: float) -> PathBands:
    runs = {
        (series.name, i): made_run(steepness * size, 0.1 + 0.01 * size)
        for series in FULL.series()
        for i, size in enumerate(series.sizes_mm)
    }
    runs["mesh", 0] = made_run(steepness * 8.0, 0.18, seconds=2.0)
    return path_bands(name, FULL.series(), runs, path_scenario(name, FULL, quick=False))


def test_bands_of_made_up_runs() -> None:
    """A tip whose offset at the shortest run's end is 0.1 mm/s h 2 s: first order in h and in the spacing."""
    bands = made_bands("line", 1.0)
    assert bands.depth_mm == pytest.approx(20.0)
    tip = bands.bands["tip_end_mm"]
    assert tip.parts["mesh"].order == pytest.approx(1.0, abs=1e-6)
    assert tip.parts["mesh"].default == pytest.approx(0.2 * (1.6 + 1.25 * 4.4))
    assert tip.parts["spacing"].default == pytest.approx(0.2 * (1.0 + 1.25 * 2.0))
    assert tip.default == pytest.approx(tip.parts["mesh"].default + tip.parts["spacing"].default)
    assert 0.0 < bands.bands["tip_path_mm"].default < tip.default
    assert bands.bands["push_n"].default == 0.0
    assert tip.apart["mesh", 8.0] == pytest.approx(0.4)


def test_a_suite_carries_the_widest_band_of_its_paths() -> None:
    paths = [made_bands(name, 1.0 + i) for i, name in enumerate(PATHS)]
    worst = suite_bands(paths, SUITES)
    assert worst["CUR"]["tip_end_mm"] == pytest.approx(4.0 * worst["LIN"]["tip_end_mm"], rel=1e-2)
    part = band_part(0.04, paths, SUITES, made_paths(), FULL)
    document = json.loads(part.files["convergence.json"])
    assert document["suites"] == worst
    assert document["band_mm"] == worst["CUR"]["tip_path_mm"]
    assert set(document["paths"]) == set(PATHS)
    assert set(worst["LIN"]) == {"tip_end_mm", "tip_path_mm", "entry_force_share", "push_share"}
    ElementTree.fromstring(part.files["convergence.svg"])
    assert "| CUR |" in part.files["convergence.md"]
    assert "## Closed loops" in part.files["convergence.md"]
    assert document["closed_loop"]["discretisation"]["dt_s"] == LOOP_DT_S


@pytest.mark.parametrize("chosen", [FULL, QUICK])
def test_every_discretisation_is_a_scenario_of_its_own(chosen: object) -> None:
    """Even counts that differ: no two of the three meshes are the same."""
    assert chosen in (FULL, QUICK)
    found = FULL if chosen is FULL else QUICK
    for name in PATHS:
        base = path_scenario(name, found, quick=chosen is QUICK)
        assert base.dt_s == found.dt_s
        cells = {tuple(base.tissue.model_copy(update={"element_size_mm": h}).cells) for h in found.sizes_mm}
        assert len(cells) == 3
        assert found.sizes_mm[1] == base.tissue.element_size_mm
        assert found.spacings_mm[1] == base.interaction.spacing_mm


def test_bands_are_around_the_default() -> None:
    default = path_scenario("line", FULL, quick=False)
    assert default.tissue.element_size_mm == type(default.tissue)().element_size_mm
    assert default.interaction.spacing_mm == 3.0
