"""Boards: who stands where, what is compared, and that a number that is none never wins."""

from __future__ import annotations

import json
import math
import re
from html.parser import HTMLParser
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

from benchmarks.bundles.check import open_bundle
from benchmarks.bundles.manifest import Choice, FileRecord, Maker, Manifest, Origin, SuiteRecord, Timing
from benchmarks.bundles.tasks import tasks_sha256
from benchmarks.bundles.verification import CaseVerification, Verification
from benchmarks.cases import Case, Label, Outcome, Suite
from benchmarks.grid.profiles import interquartile_mean
from benchmarks.leaderboard.boards import Entry, document
from benchmarks.leaderboard.pages import pages
from tests.benchmarks.paper.synthetic import outcome

if TYPE_CHECKING:
    from collections.abc import Mapping

ERRORS = {"good": 0.1, "fair": 0.2, "bad": 0.4}


def outcomes(errors: Mapping[str, float], *, count: int = 8, replace: Any = None) -> list[Outcome]:
    """Each arm along `count` paths; `replace` of (arm, number) gives another error, or None."""
    found = []
    for arm, error in errors.items():
        for i in range(count):
            other = None if replace is None else replace(arm, i)
            value = error + 0.01 * i if other is None else other
            labels: dict[str, Label] = {"arm": arm, "end_point": i}
            found.append(outcome(f"{arm} {i}", value, labels, end_mm=(2.0 + i, 31.0)))
    return found


def entry(mine: list[Outcome], *, name: str = "suite-v1", l0_ms: float | None = 0.5, recorded: int = 1) -> Entry:
    suite = Suite(name, "", tuple(one.case for one in mine))
    tasks = tasks_sha256(one.case.scenario for one in mine)
    recorded_files = [FileRecord(name=f"recordings/{one.case.id}.rrd", bytes=1, sha256="0" * 64) for one in mine]
    manifest = Manifest(
        schema="needlebench/bundle/1",
        division="closed",
        suite=SuiteRecord(name=name, sha256=suite.sha256, tasks_sha256=tasks, cases=len(mine)),
        arms=[],
        origins=[Origin(cases=len(mine), commit="f" * 40, cpu="a <b>processor</b>")],
        made_with=Maker(version="1", commit=None, lock_sha256=None),
        chosen=Choice(seed=0, asked=recorded, cases=[one.case.id for one in mine[:recorded]]),
        timing=None if l0_ms is None else Timing(l0_ms=l0_ms, cpu="a"),
        warnings=[],
        failed=0,
        named_files=[],
        renamed=0,
        files=recorded_files[:recorded],
    )
    return Entry(manifest, mine)


def test_arms_are_ranked_by_their_interquartile_means() -> None:
    (board,) = document([entry(outcomes(ERRORS))])["boards"]
    assert [line["arm"] for line in board["lines"]] == ["good", "fair", "bad"]
    best = board["lines"][0]
    assert best["iqm_mm"] == pytest.approx(interquartile_mean([0.1 + 0.01 * i for i in range(8)]))  # type: ignore[arg-type]
    low, high = best["iqm_interval_mm"]
    assert low < best["iqm_mm"] < high
    assert best["worst_mm"] == pytest.approx(0.1 + 0.01 * 0.95 * 7)
    assert best["command_l0"] == pytest.approx((0.6 + 0.15) / 0.5)
    couples = {frozenset((c["first"], c["second"])) for c in board["comparisons"]}
    assert couples == {frozenset(("good", "fair")), frozenset(("good", "bad")), frozenset(("fair", "bad"))}


@pytest.mark.parametrize("value", [math.inf, math.nan, -math.inf])
def test_what_is_no_number_never_wins(value: float) -> None:
    mine = outcomes(ERRORS, replace=lambda arm, _: value if arm == "good" else None)
    (board,) = document([entry(mine)])["boards"]
    assert [line["arm"] for line in board["lines"]] == ["fair", "bad", "good"]
    assert (board["lines"][-1]["iqm_mm"], board["lines"][-1]["worst_mm"]) == (None, None)


def test_a_few_failures_cost_the_worst_and_not_the_middle() -> None:
    mine = outcomes(ERRORS, replace=lambda arm, i: math.inf if (arm, i) == ("good", 7) else None)
    (board,) = document([entry(mine)])["boards"]
    assert (board["lines"][0]["arm"], board["lines"][0]["failed"]) == ("good", 1)
    assert board["lines"][0]["worst_mm"] is None


def test_bundles_of_the_same_tasks_share_a_board_and_others_do_not() -> None:
    ours, theirs = entry(outcomes(ERRORS)), entry(outcomes({"theirs": 0.05, "good": 0.15}), name="their grid")
    other = entry(outcomes({"good": 0.1}, count=5), name="shorter-v1")
    found = document([ours, theirs, other])["boards"]
    assert sorted(len(board["bundles"]) for board in found) == [1, 2]
    board = next(one for one in found if len(one["bundles"]) == 2)
    assert board["title"] == "suite-v1 / their grid"
    names = [line["arm"] for line in board["lines"]]
    assert names == ["theirs", f"good · {ours.id[:6]}", f"good · {theirs.id[:6]}", "fair", "bad"]
    assert board["profiles"]["cases"] == 8


def test_only_tasks_that_all_arms_ran_are_in_the_means() -> None:
    mine = outcomes(ERRORS)
    few = entry([one for one in mine if one.case.labels["arm"] != "bad" or int(one.case.labels["end_point"]) < 4])
    (board,) = document([few])["boards"]
    assert (board["profiles"]["cases"], board["profiles"]["places"]) == (4, 8)
    assert {line["cases"] for line in board["lines"]} == {4}


def test_a_controller_alone_has_a_board_too() -> None:
    (board,) = document([entry(outcomes({"alone": 0.1}), l0_ms=None)])["boards"]
    assert board["lines"][0]["iqm_mm"] is not None
    assert (board["lines"][0]["command_l0"], board["comparisons"]) == (None, [])


class _Links(HTMLParser):
    def __init__(self, text: str) -> None:
        super().__init__()
        self.links: list[str] = []
        self.ids: set[str] = set()
        self.tags: set[str] = set()
        self.feed(text)

    def handle_starttag(self, tag: str, attributes: list[tuple[str, str | None]]) -> None:
        known = dict(attributes)
        self.tags.add(tag)
        self.links += [address] if (address := known.get("href")) else []
        self.ids |= {name} if (name := known.get("id")) else set()


def test_pages_need_nothing_and_every_link_leads_somewhere() -> None:
    record = Verification(
        schema="needlebench/verification/1", bundle="0" * 64, suite="s", at="2026-11-30T08:00:00Z", by="<script>x",
        seed=1, code=Origin(cases=1), cases=[CaseVerification(id="good 0", result="identical")],
    )  # fmt: skip
    one = entry(outcomes(ERRORS), recorded=2)
    figures = document([Entry(one.manifest, one.outcomes, (record,))])
    shown = dict(pages(figures, title="Ours & theirs"))
    (board,) = figures["boards"]
    assert set(shown) == {"index.html", board["file"]}
    files = {*shown, "leaderboard.json", *(b["file"] for b in board["bundles"])}
    files |= {r["file"] for b in board["bundles"] for r in b["recordings"]}
    for text in shown.values():
        page = _Links(text)
        assert not page.tags & {"script", "img", "iframe", "link", "object"}
        assert not re.search(r"https?://(?!www\.w3\.org/)|@import|url\((?!#)", text)
        for link in page.links:
            name, _, anchor = link.partition("#")
            assert name in files or (not name and anchor in page.ids), link
    assert "&lt;script&gt;x" in shown[board["file"]]
    assert "a &lt;b&gt;processor" in shown[board["file"]]
    page = _Links(shown[board["file"]])
    assert page.links.count(f"#b-{one.id[:12]}") >= 3 * 8, "every figure leads to its bundle"
    assert all(r["file"] in page.links for b in board["bundles"] for r in b["recordings"])


def test_the_committed_example_is_whole_and_small() -> None:
    site = Path(__file__).resolve().parents[3] / "benchmarks" / "results" / "leaderboard"
    entries = []
    for path in sorted((site / "bundles").glob("*.zip")):
        with open_bundle(path, wanted_id=path.stem) as bundle:
            entries.append(Entry(bundle.manifest, bundle.outcomes))
    committed = json.loads((site / "leaderboard.json").read_text())
    (board,) = committed["boards"]
    (again,) = document(entries)["boards"]
    assert [(line["arm"], line["iqm_mm"]) for line in again["lines"]] == [
        (line["arm"], pytest.approx(line["iqm_mm"])) for line in board["lines"]
    ]
    assert sum(file.stat().st_size for file in site.rglob("*") if file.is_file()) < 1_000_000


def test_a_case_does_not_matter_by_its_name() -> None:
    """The same tasks under other names and ids are the same tasks."""
    mine = outcomes(ERRORS)
    renamed = [Outcome(Case(f"x{i}", {**one.case.scenario, "name": f"n{i}"}, one.case.labels), one.result)
               for i, one in enumerate(mine)]  # fmt: skip
    assert entry(mine).manifest.suite.tasks_sha256 == entry(renamed).manifest.suite.tasks_sha256
