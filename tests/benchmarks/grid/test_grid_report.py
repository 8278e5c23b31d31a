"""The report of a grid: points, effects of each field, and a page that says nothing of the paper."""

from __future__ import annotations

import json
import math
from typing import TYPE_CHECKING, Any

import pytest

from benchmarks.grid.page import html
from benchmarks.grid.report import SCHEMA, document
from benchmarks.grid.suite import grid
from tests.benchmarks.paper.synthetic import outcome
from tests.benchmarks.paper.test_paper_report import Page

if TYPE_CHECKING:
    from benchmarks.cases import Outcome

FIRST = "ifem, E 3.0, target 18 31 100, seed 0"
AXES: dict[str, list[Any]] = {
    "controller.kind": ["ifem", "open_loop"],
    "tissue.young_kpa": [3.0, 5.0, 8.0],
    "trajectory.target_mm": [[18, 31, 100], [20, 31, 100]],
    "seed": [0, 1],
}


def outcomes(axes: dict[str, list[Any]] = AXES, *, failing: str = "") -> list[Outcome]:
    """I-FEM errs by 0.3 mm / E, the open loop ten times as much; the second path and the second seed add a little."""
    found = []
    for case in grid({"noise_mm": 0.25}, axes).cases:
        labels = case.labels
        rmse = 0.3 / float(labels.get("tissue.young_kpa", 1.0)) * (10.0 if labels["arm"] == "open_loop" else 1.0)
        rmse += 1e-3 * int(labels.get("seed", 0)) + 2e-3 * str(labels.get("trajectory.target_mm")).startswith("[20")
        found.append(outcome(case.id, math.inf if case.id == failing else rmse, labels))
    return found


@pytest.fixture(scope="module")
def report() -> dict[str, Any]:
    links = {case.case.id: f"/jobs/{case.case.id}" for case in outcomes()}
    return document(outcomes(), AXES, name="stiffness", links=links, provenance={"campaign": "c1"})


def test_every_point_once_with_its_seeds_in_it(report: dict[str, Any]) -> None:
    points = report["points"]
    assert report["schema"] == SCHEMA
    assert report["counts"] == {"insertions": 24, "failed": 0, "points": 12}
    assert [point["insertions"] for point in points] == [2] * 12
    assert points[0]["place"] == {"arm": "ifem", "tissue.young_kpa": 3.0, "trajectory.target_mm": "[18, 31, 100]"}
    assert points[0]["median_mm"] == pytest.approx(0.1005)
    assert points[0]["step_ms"] == pytest.approx(1.9 + 0.6 + 0.15)


def test_a_field_is_compared_where_all_else_is_the_same(report: dict[str, Any]) -> None:
    effects = {effect["field"]: effect for effect in report["effects"]}
    assert list(effects) == ["tissue.young_kpa", "trajectory.target_mm"]
    (controllers,) = report["comparisons"]
    assert (controllers["first"], controllers["second"]) == ("ifem", "open_loop")
    assert (controllers["pairs"], controllers["clusters"], controllers["unit"]) == (12, 6, "case")
    assert "those that differ in their seed alone count once" in " ".join(controllers["notes"])
    assert controllers["p_primary"] == controllers["p_holm"] == pytest.approx(2 * 0.5**6)
    stiffness = effects["tissue.young_kpa"]
    assert stiffness["numeric"]
    found = {(c["group"], c["first"], c["second"]): c["difference_mm"] for c in stiffness["contrasts"]}
    assert len(found) == 6
    assert found["ifem", "3.0", "5.0"] == pytest.approx(0.3 / 3 - 0.3 / 5)
    assert found["open_loop", "3.0", "8.0"] == pytest.approx(3.0 / 3 - 3.0 / 8)
    assert not effects["trajectory.target_mm"]["numeric"]
    paths = effects["trajectory.target_mm"]["contrasts"]
    assert [c["difference_mm"] for c in paths] == pytest.approx([-2e-3, -2e-3])


def test_many_values_are_compared_with_the_first() -> None:
    axes: dict[str, list[Any]] = {"tissue.young_kpa": [1.0, 2.0, 3.0, 4.0, 5.0, 6.0], "dt_s": [0.01, 0.02]}
    effect, _ = document(outcomes(axes), axes, name="six")["effects"]
    assert [(c["first"], c["second"]) for c in effect["contrasts"]] == [("1.0", f"{i}.0") for i in range(2, 7)]


def test_seeds_alone_are_no_effect_and_one_point() -> None:
    axes: dict[str, list[Any]] = {"seed": [0, 1, 2]}
    report = document(outcomes(axes), axes, name="repeats")
    assert report["effects"] == []
    assert [point["insertions"] for point in report["points"]] == [3]
    assert "each with 3 seeds" in Page(html(report)).text


@pytest.mark.slow
def test_a_failure_ranks_behind_everything_and_is_listed() -> None:
    report = document(outcomes(failing=FIRST), AXES, name="stiffness", links={FIRST: "/jobs/7"})
    point = report["points"][0]
    assert (point["failed"], point["median_mm"], point["worst_error_mm"]) == (1, None, None)
    assert [(f["id"], f["link"]) for f in report["failures"]] == [(FIRST, "/jobs/7")]
    text = html(report)
    assert "Failed" in text
    assert 'href="/jobs/7"' in text


@pytest.mark.slow
def test_the_page_is_sound_and_says_nothing_of_the_paper(report: dict[str, Any]) -> None:
    text = html(report)
    page = Page(text)
    assert text == html(json.loads(json.dumps(report, allow_nan=False)))
    assert page.words[page.words.index("stiffness")] == "stiffness"
    assert not {"script", "link", "img"} & {name for name, _ in page.tags}
    assert all(attrs.get("scope") in ("col", "row", "rowgroup") for attrs in page.of("th"))
    body = text.partition("</style>")[2]
    for word in ("claim", "Perrusi", "ELM", "LIN", "constant"):
        assert word not in body, word
    ids = [attrs["id"] for _, attrs in page.tags if "id" in attrs]
    assert len(ids) == len(set(ids))
    links = [str(attrs["href"]) for attrs in page.of("a")]
    assert {link[1:] for link in links if link.startswith("#")} <= set(map(str, ids))
    assert {f"/jobs/{one['id']}" for one in report["chosen"]} <= set(links)
    assert {one["why"] for one in report["chosen"]} >= {"best", "median", "worst"}
    assert len([attrs for attrs in page.of("svg") if attrs.get("role") == "img"]) == 1 + 1 + 2
    assert "0.038 mm with I-FEM, tissue.young_kpa = 8.0" in page.text


def test_names_from_outside_stay_text() -> None:
    hostile = "<script>alert(1)</script>"
    axes: dict[str, list[Any]] = {"name": ["a", "b"]}
    report = document(outcomes(axes), axes, name=hostile)
    assert "<script>alert" not in html(report)


def test_nothing_that_has_ended_is_a_page_too() -> None:
    report = document([], AXES, name="just begun")
    assert "none of them failed" in Page(html(report)).text
