"""Arc, waypoints and reach: what is refused, from where they come, and runs along them."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from simcore.errors import ScenarioError, Status
from simcore.rollout.rollout import run
from simcore.scenario.path_rules import largest_curvature_per_m
from simcore.scenario.scenario import Scenario
from simcore.scenario.waypoint_file import read_waypoints, with_waypoints
from tests.simcore.short_run import short

if TYPE_CHECKING:
    from pathlib import Path

ENTRY = [12, 20, 0]
ARC = {"kind": "arc", "entry_mm": ENTRY, "target_mm": [12, 22, 20], "radius_mm": 200}
POINTS = {"kind": "waypoints", "entry_mm": ENTRY, "points_mm": [[12.1, 20.5, 10], [12, 21.5, 20]]}
REACH: dict[str, Any] = {"kind": "reach", "entry_mm": ENTRY, "target_mm": [12, 21, 20], "time_s": 4}


@pytest.mark.parametrize("trajectory", [ARC, POINTS], ids=["arc", "waypoints"])
def test_ifem_follows_a_new_kind_of_path(trajectory: dict[str, Any]) -> None:
    found = run(short(trajectory=trajectory, noise_mm=0.0))
    path, series = found.scenario.path(), found.series
    assert (found.status, found.success) == (Status.COMPLETED, True)
    assert found.metrics["rmse_commanded_mm"] < 0.1
    assert path.distance_m(series["target_m"]).max() < 1e-9
    assert np.linalg.norm(np.diff(series["target_m"][:-1], axis=0), axis=1).std() < 2e-6
    np.testing.assert_allclose(1e3 * series["target_m"][-1], found.scenario.trajectory.end_mm, atol=1e-9)


@pytest.mark.parametrize("trajectory", [ARC, POINTS, REACH], ids=["arc", "waypoints", "reach"])
def test_the_tissue_carries_a_new_kind_of_path(trajectory: dict[str, Any]) -> None:
    breathing = {"kind": "breathing", "amplitude_mm": 1, "period_s": 2}
    found = run(short(trajectory={**trajectory, "frame": "tissue"}, motion=breathing, noise_mm=0.0))
    assert found.status is Status.COMPLETED
    assert (found.metrics["cross_track_rmse_mm"] is None) == (trajectory is REACH)


@pytest.mark.parametrize("kind", ["ifem", "open_loop", "rigid", "elm"])
def test_a_target_without_a_path_is_reached_in_time(kind: str) -> None:
    """The elm was trained beside its target, and says nothing of far ones: it need not arrive."""
    found = run(short(trajectory=REACH, controller={"kind": kind}, noise_mm=0.0))
    assert found.status is Status.COMPLETED
    assert len(found.series["t_s"]) == 41
    targets_mm = np.tile(np.asarray(REACH["target_mm"], float), (41, 1))
    np.testing.assert_allclose(1e3 * found.series["target_m"], targets_mm, atol=1e-9)
    assert found.metrics["cross_track_rmse_mm"] is None
    assert found.metrics["max_same_time_mm"] > 10.0
    if kind != "elm":
        assert found.success
        assert found.metrics["final_same_time_mm"] < 1.0


def test_a_target_that_is_not_reached_in_time_is_no_success() -> None:
    found = run(
        short(
            trajectory={**REACH, "time_s": 0.2},
            noise_mm=0.0,
            controller={"kind": "open_loop"},
            robot={"max_speed_mm_s": 5},
        )
    )
    assert (found.status, found.success) == (Status.COMPLETED, False)


# ---- refusals


@pytest.mark.parametrize(
    ("trajectory", "message"),
    [
        ({**ARC, "radius_mm": 9}, r"radius_mm = 9\.0: must be at least 10\.0499 mm, half of the distance"),
        (
            {**ARC, "radius_mm": 100},
            r"radius_mm = 100\.0: must not bend .* 123\.3 mm.* first at \[12\.0000, 20\.0000, 0\.",
        ),
        ({**ARC, "direction": [0, 2, 20]}, r"direction = .*across the path"),
        (
            {**ARC, "target_mm": [23.9, 22, 30], "radius_mm": 124, "entry_mm": [23, 20, 0]},
            r"radius_mm.*leaves it at \[24\.",
        ),
        ({**ARC, "target_mm": [12, 22, 41]}, r"target_mm = .*must lie below the entry"),
        (
            {**POINTS, "points_mm": [[12, 20, 10], [25, 20, 20]]},
            r"points_mm\[1\] = \[25\.0, 20\.0, 20\.0\]: must lie below",
        ),
        (
            {**POINTS, "points_mm": [[12, 20, 10], [12, 20, 10.05]]},
            r"points_mm\[1\] = .*at least 0\.1 mm from trajectory\.points_mm\[0\]",
        ),
        (
            {**POINTS, "points_mm": [[12, 20, 0.05], [12, 20, 5]]},
            r"points_mm\[0\] = .*at least 0\.1 mm from trajectory\.entry_mm",
        ),
        (
            {**POINTS, "points_mm": [[12, 20, 10], [14, 20, 20], [12, 20, 30]]},
            r"points_mm\[0\] = .*tighter than a radius of 123\.3 mm.*first at .* mm along, and to \d",
        ),
        (
            {**POINTS, "entry_mm": [0.5, 20, 0], "points_mm": [[0.01, 20, 10], [0.01, 20, 30], [0.5, 20, 40]]},
            r"points_mm\[1\] = .*inside the block; it leaves it at \[-0\.0",
        ),
        ({**POINTS, "points_mm": []}, r"points_mm = \[\]: .*at least 1"),
        ({**POINTS, "points_mm": [[12, 20]]}, r"points_mm\[0\]"),
        ({**REACH, "time_s": 0}, r"time_s = 0: .*0\.1 to 1000"),
        ({**REACH, "speed_mm_s": 5}, r"trajectory\.speed_mm_s = 5: unknown field; known here: .*time_s"),
        ({**REACH, "target_mm": [12, 21, 50]}, r"target_mm = .*must lie below"),
    ],
)
def test_a_path_that_cannot_be_is_refused_with_its_first_place(trajectory: dict[str, Any], message: str) -> None:
    with pytest.raises(ScenarioError, match=message):
        short(trajectory=trajectory)


def test_the_tightest_bend_is_that_of_the_yield_stress() -> None:
    """yield / (E r): 1030 MPa, 200 GPa, 0.635 mm; a needle of twice the yield stress may bend twice as tight."""
    assert 1e3 / largest_curvature_per_m(short().needle) == pytest.approx(200e3 / 1030 * 0.635)
    short(trajectory={**ARC, "radius_mm": 100}, needle={"yield_mpa": 2060})
    with pytest.raises(ScenarioError, match=r"61\.65 mm"):
        short(trajectory={**ARC, "radius_mm": 61}, needle={"yield_mpa": 2060})


def test_a_needle_that_is_too_short_for_its_curve_is_refused() -> None:
    with pytest.raises(ScenarioError, match=r"needle\.length_mm = 30\.0: must be at least 40\.1"):
        short(trajectory=ARC, needle={"length_mm": 30})


def test_points_in_metres_are_warned_of() -> None:
    points = {"kind": "waypoints", "entry_mm": ENTRY, "points_mm": [[12, 20, 0.2]]}
    assert any("points in metres" in line for line in short(trajectory=points).warnings())


# ---- where points come from


def test_points_are_an_array_of_numpy_too() -> None:
    array = np.array(POINTS["points_mm"])
    assert (
        short().load({**short().resolved(), "trajectory": {**POINTS, "points_mm": array}}).trajectory
        == short(trajectory=POINTS).trajectory
    )
    with pytest.raises(ScenarioError, match="is not JSON"):
        Scenario.load({"trajectory": {"points_mm": {1, 2}}})


@pytest.mark.parametrize("heading", ["", "x_mm,y_mm,z_mm\n"])
def test_points_come_from_a_table(heading: str, tmp_path: Path) -> None:
    file = tmp_path / "points.csv"
    file.write_text(heading + "12.1,20.5,10\n12,21.5,20\n")
    np.testing.assert_array_equal(read_waypoints(file), POINTS["points_mm"])
    data = with_waypoints({"trajectory": {"kind": "sine", "entry_mm": ENTRY, "speed_mm_s": 5, "periods": 2}}, file)
    assert data["trajectory"] == {**POINTS, "speed_mm_s": 5}
    assert with_waypoints({}, file)["trajectory"]["kind"] == "waypoints"


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("", "is no table of numbers"),
        ("1,2,3\n4,5\n", "is no table of numbers"),
        ("a,b,c\n1,2,x\n", "is no table of numbers"),
        ("1,2\n3,4\n", "must be 1 to 500 rows of x_mm, y_mm, z_mm, and is 2 x 2"),
        ("1,2,3\n" * 501, "must be 1 to 500 rows of x_mm, y_mm, z_mm, and is 501 x 3"),
        ("1,2,3\n4,nan,6\n", r"row 2 must be finite, and is \[4\.0, nan, 6\.0\]"),
    ],
)
def test_a_table_that_is_none_is_refused(content: str, message: str, tmp_path: Path) -> None:
    file = tmp_path / "points.csv"
    file.write_text(content)
    with pytest.raises(ScenarioError, match=message):
        read_waypoints(file)
    with pytest.raises(ScenarioError, match="cannot be read"):
        read_waypoints(tmp_path / "nothing.csv")
