"""The report: self-contained, complete, readable without colours or sight, and the same for the same outcomes."""

from __future__ import annotations

import json
import math
import re
from html.parser import HTMLParser
from typing import TYPE_CHECKING, Any
from xml.etree import ElementTree

import pytest

from benchmarks.cases import Case, Label, Outcome
from benchmarks.paper.bands import Bands
from benchmarks.paper.failure_places import notable_cases
from benchmarks.paper.page import change, change_interval, html, interval, mm, p_value, percent, share, signed
from benchmarks.paper.pipeline import cases_to_record
from benchmarks.paper.report import SCHEMA, document, main_table_markdown, write
from benchmarks.paper.table import BESIDE, rows
from tests.benchmarks.paper.synthetic import (
    experiments,
    labelled,
    learning,
    outcome,
    scenario,
    seeds,
    sensitivity,
    timings,
)

if TYPE_CHECKING:
    from pathlib import Path

VOID = {"meta", "col", "br"}
PROVENANCE = {"commit": "abc", "suites": {"lin100-v2": "0" * 64}, "seeds": [1, 2], "load": None}


class Page(HTMLParser):
    """Tags with their attributes, the words, and whether every tag was closed in turn."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.words: list[str] = []
        self.open: list[str] = []
        self.feed(text)
        assert not self.open

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.words.append(data)

    @property
    def text(self) -> str:
        return " ".join(" ".join(self.words).split())

    def of(self, tag: str) -> list[dict[str, str | None]]:
        return [attrs for name, attrs in self.tags if name == tag]


def everything() -> dict[str, Any]:
    outcomes = [*experiments(12), *seeds(), *sensitivity(), outcome("mlp", 0.1, labelled("LIN", "mlp", 0, ""))]
    links = {case_id: f"recordings/{case_id}.rrd" for case_id, _ in notable_cases(rows(outcomes))}
    return document(
        outcomes, timing=timings(), learning=learning(), recordings=links, scale="quick", provenance=PROVENANCE
    )


@pytest.fixture(scope="module")
def report() -> dict[str, Any]:
    return everything()


@pytest.fixture(scope="module")
def page(report: dict[str, Any]) -> Page:
    return Page(html(report))


# ---- the JSON


@pytest.mark.slow
def test_the_document_is_plain_json_and_the_page_follows_from_it(report: dict[str, Any]) -> None:
    again = json.loads(json.dumps(report, allow_nan=False))
    assert again["schema"] == SCHEMA
    assert html(again) == html(report)


@pytest.mark.slow
def test_the_order_of_outcomes_changes_nothing() -> None:
    outcomes = [*experiments(5), *seeds(4), *sensitivity()]
    one = document(outcomes, timing=timings(), learning=learning())
    assert document(outcomes[::-1], timing=timings()[::-1], learning=learning()[::-1]) == one


@pytest.mark.slow
def test_every_part_is_there(report: dict[str, Any]) -> None:
    assert len(report["claims"]) == 11
    assert {s["arm"] for s in report["scores"]} == {"ifem", "elm", "mlp", "open_loop", "rigid"}
    assert report["face_mm"] == [36.0, 62.0]
    assert report["entry_mm"] == [18.0, 31.0]
    assert len(report["seeds"]["shares"]) == 2
    assert [c["varied"] for c in report["directions"]] == ["+x", "+y", "-x", "-y"]
    assert {s["curve"] for s in report["learning"]} == {"nodes", "samples"}
    assert len(report["sensitivity"]) == 8
    assert [c["way"] for c in report["timing"]["costs"]] == ["I-FEM, constraint", "I-FEM, perturbation", "ELM"]
    assert report["failures"]
    assert all(r["link"] == f"recordings/{r['id']}.rrd" for r in report["recordings"])


# ---- the page


@pytest.mark.slow
def test_the_page_says_which_band_each_claim_was_held_against() -> None:
    known: dict[str, float | None] = {"ifem": 0.011, "elm": None, "elm minus ifem-axis": 0.03, "elm minus ifem": 0.02}
    report = document(experiments(5), bands=Bands({"LIN": known, "CUR": known}, source="a study"))
    assert report["bands"]["suites"]["CUR"] == known
    text = Page(html(report)).text
    assert "Band, I-FEM minus ELM on CUR: 0.02 mm" in text
    assert "Band, RMSE of I-FEM and ELM on ALL: unknown" in text
    assert "Bands of this discretisation (a study): RMSE of I-FEM on LIN: 0.011 mm; RMSE of ELM on LIN: unknown" in text
    assert "ELM minus I-FEM, axis on CUR: 0.03 mm; ELM minus I-FEM on CUR: 0.02 mm." in text
    unknown = Page(html(document(experiments(5)))).text
    assert "Bands of this discretisation: unknown, so that nothing the mesh may change is decided." in unknown


@pytest.mark.slow
def test_the_page_needs_nothing_else(page: Page, report: dict[str, Any]) -> None:
    text = html(report)
    assert not page.of("script")
    assert not page.of("link")
    assert not page.of("img")
    without_names = text.replace("http://www.w3.org/2000/svg", "")
    assert not re.search(r"https?://|url\((?!#)|@import", without_names)


def test_the_page_can_be_read_without_seeing_it(page: Page) -> None:
    assert page.of("html")[0]["lang"] == "en"
    assert len(page.of("h1")) == 1
    assert all(attrs.get("scope") in ("col", "row", "rowgroup") for attrs in page.of("th"))
    large = [attrs for attrs in page.of("svg") if attrs.get("role") == "img"]
    assert len(large) > 10
    ids = [attrs["id"] for _, attrs in page.tags if "id" in attrs]
    assert len(ids) == len(set(ids))
    for attrs in large:
        assert set(str(attrs["aria-labelledby"]).split()) <= set(ids)
    assert all(attrs.get("aria-hidden") == "true" for attrs in page.of("svg") if attrs.get("role") != "img")


def test_links_within_the_page_lead_somewhere(page: Page) -> None:
    ids = {attrs["id"] for _, attrs in page.tags if "id" in attrs}
    inner = [str(attrs["href"]) for attrs in page.of("a") if str(attrs["href"]).startswith("#")]
    assert len(inner) == 11
    assert {href[1:] for href in inner} <= ids


def test_the_page_shows_claims_provenance_and_recordings(page: Page, report: dict[str, Any]) -> None:
    for claim in report["claims"]:
        assert claim["claim"] in page.text
        assert claim["reason"] in page.text
    assert "0" * 64 in page.text
    assert "1, 2" in page.text
    assert sum(str(attrs["href"]).startswith("recordings/") for attrs in page.of("a")) == len(report["recordings"])


@pytest.mark.slow
def test_other_recorded_cases_are_linked_too() -> None:
    outcomes = experiments(6)
    everywhere = {row.id: f"r/{row.id}.rrd" for row in rows(outcomes)}
    found = document(outcomes, recordings={**everywhere, "unknown": "r/x.rrd"})["recordings"]
    assert {r["id"] for r in found} == set(everywhere)
    assert {"best", "median", "worst", "another"} <= {r["why"] for r in found}


def test_names_are_escaped() -> None:
    labels: dict[str, Label] = {"group": "<xb>&'\"", "arm": "<xi>", "end_point": "<xu>"}
    outcomes = [outcome("<script>", 0.1, labels), outcome("x", 0.1, {**labels, "arm": "elm"})]
    recorded = {"<script>": "a\"b<'.rrd"}
    text = html(document(outcomes, recordings=recorded, scale="<xs>", provenance={"<xp>": "<xq>"}))
    Page(text)
    assert not re.search(r"<(script|x.)>", text)


@pytest.mark.slow
@pytest.mark.parametrize("outcomes", [[], [Outcome(Case("c", scenario((18.0, 31.0)), {}), {})]])
def test_a_page_of_nothing_or_of_failures_alone(outcomes: list[Outcome]) -> None:
    report = document(outcomes)
    found = Page(html(report))
    assert "undecided" in found.text
    assert "No insertion of this run was recorded." in found.text
    assert main_table_markdown(report).count("\n") == 2 + len(outcomes)


@pytest.mark.slow
def test_all_failed_groups_are_written_as_failed() -> None:
    outcomes = [Outcome(o.case, {"status": "not_converged"}) for o in [*experiments(3), *seeds(2), *sensitivity()]]
    times = [Outcome(o.case, {"status": "not_converged"}) for o in timings()]
    report = document(outcomes, timing=times)
    text = Page(html(report)).text
    assert text.count("failed") > 2 * len(report["scores"])  # median and quartiles of each
    assert "failed – failed" not in text
    assert "None" not in text
    assert not re.search(r"\bnan\b", text)
    assert "| failed (failed to failed) |" in main_table_markdown(report)


def test_a_campaign_without_the_papers_labels() -> None:
    """Groups and controllers of somebody else: their scores are shown, the paper's claims are undecided."""
    outcomes = [
        outcome(f"{arm}{i}", 0.1 + 0.01 * i, {"group": "liver", "arm": arm, "end_point": i})
        for arm in ("ifem", "mine")
        for i in range(4)
    ]
    report = document(outcomes)
    assert {claim["verdict"] for claim in report["claims"]} == {"undecided"}
    text = Page(html(report)).text
    assert "liver" in text
    assert "mine" in text


# ---- files and tables


@pytest.mark.slow
def test_files_are_written_and_replaced(tmp_path: Path) -> None:
    def written(count: int) -> dict[str, bytes]:
        paths = write(
            experiments(count),
            timing=timings(),
            learning=learning(),
            recordings={},
            scale="smoke",
            out=tmp_path / "new",
            provenance=PROVENANCE,
        )
        assert sorted(paths) == sorted((tmp_path / "new").iterdir())
        return {path.name: path.read_bytes() for path in paths}

    first, second, third = written(3), written(4), written(3)
    assert set(first) == {"report.json", "report.html", "insertions.csv", "headline.svg"}
    assert first == third
    assert all(first[name] != second[name] for name in first)
    assert json.loads(first["report.json"])["scale"] == "smoke"
    assert first["insertions.csv"].count(b"\n") == 1 + len(experiments(3)) + len(timings())
    picture = ElementTree.fromstring(first["headline.svg"])
    words = {element.text for element in picture.iter("{http://www.w3.org/2000/svg}text")}
    assert {"LIN", "CUR", "ALL", "I-FEM", "ELM", "open loop", "rigid"} <= words


def test_the_main_table_is_that_of_the_primary_condition(report: dict[str, Any]) -> None:
    lines = main_table_markdown(report).splitlines()
    assert all(line.count("|") == 9 + len(BESIDE) for line in lines)
    assert len(lines) == 2 + 3 * 4 + 1  # three groups of four, and the small network on LIN
    ifem = next(s for s in report["scores"] if (s["group"], s["arm"], s["noise"]) == ("CUR", "ifem", "off"))
    row = next(line for line in lines if line.startswith("| CUR | I-FEM"))
    assert f"| {ifem['median_mm']:.3f} (" in row
    assert "| 100 % |" in row


def difference(middle: float | None, ends: list[float | None], *, below: int) -> dict[str, Any]:
    """What a comparison of five end points says of its difference."""
    return {
        "difference_mm": middle,
        "difference_interval_mm": ends,
        "clusters_below": below,
        "clusters_above": 5 - below,
    }


@pytest.mark.parametrize(
    ("shown", "text"),
    [
        (mm(0.0123456), "0.012"),
        (mm(None), "–"),
        (signed(-0.5), "−0.500"),
        (percent(1.0), "100 %"),
        (percent(0.9812), "98.1 %"),
        (interval([None, -0.25]), "[failed, −0.250]"),
        (p_value(3e-7), "< 0.0001"),
        (p_value(0.0042), "0.0042"),
        (p_value(0.01203), "0.012"),
        (signed(-0.00032), "−0.0003"),
        (signed(1e-7), "0.000"),
        (share([-0.202, 0.267]), "[−20.2, 26.7]"),
        (change(difference(None, [None, None], below=9)), "−∞"),
        (change_interval(difference(None, [None, None], below=1)), "[+∞, +∞]"),
        (change_interval(difference(-0.01, [None, 0.25], below=4)), "[−∞, 0.250]"),
        (p_value(0.5), "0.50"),
    ],
)
def test_numbers_for_people(shown: str, text: str) -> None:
    assert shown == text


def test_failed_insertions_are_recorded_before_those_that_only_lost_their_target() -> None:
    def case(number: int, arm: str, rmse_commanded_mm: float) -> Outcome:
        return outcome(f"{number}-{arm}", rmse_commanded_mm, labelled("LIN", arm, number, "") | {"purpose": "main"})

    good = [case(number, "elm", 0.1 * (number + 1)) for number in range(3)]
    lost = [case(3, "open_loop", 2.0), case(4, "rigid", math.inf), case(5, "elm", 1.9), case(6, "elm", math.inf)]
    found = [made.case.id for made in cases_to_record([*lost, *good], failed=2)]
    assert found[-2:] == ["6-elm", "4-rigid"]
    assert {"0-elm", "5-elm"} <= set(found)
