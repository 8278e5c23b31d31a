"""The generated parts: nothing of the model is missing from them, and committed numbers arrive as they are."""

from __future__ import annotations

import csv
import json
import re
import statistics
from collections import Counter

import pytest

from simcore.errors import STATUSES
from simcore.metric_definitions import METRICS, SERIES
from simcore.scenario.parameters import parameters
from tests.docs.sources import DOCS, ROOT, program

RESULTS = ROOT / "benchmarks" / "results"
ASKED = re.compile(r"^<!-- generated: (.+?) -->$", re.MULTILINE)


def asked_for() -> dict[str, list[str]]:
    """Page -> the parts that it asks for."""
    found = {page.name: ASKED.findall(page.read_text(encoding="utf-8")) for page in sorted(DOCS.glob("*.md"))}
    return {page: names for page, names in found.items() if names}


def shown_on(page: str) -> str:
    return "\n".join(program("page_tables").part(name) for name in asked_for()[page])


def cells(row: str) -> list[str]:
    return [cell.strip() for cell in row.strip("|").split("|")]


@pytest.mark.slow
@pytest.mark.parametrize("name", sorted({name for names in asked_for().values() for name in names}))
def test_every_part_that_a_page_asks_for_is_there(name: str) -> None:
    assert program("page_tables").part(name).strip()


@pytest.mark.slow
def test_the_page_about_http_lists_every_kind_of_problem() -> None:
    from service.api.problem_codes import CODES

    page = shown_on("http_api.md")
    assert [code for code in CODES if f"| `{code}` |" not in page] == []


@pytest.mark.parametrize("name", ["nosuch", "parameters: nosuch", "metrics: nosuch", "help: nosuch"])
def test_a_part_that_there_is_not_is_an_error(name: str) -> None:
    with pytest.raises(KeyError):
        program("page_tables").part(name)


def test_every_parameter_is_on_its_page() -> None:
    shown = shown_on("parameters.md")
    kinds = {row.default.strip('"') for row in parameters() if row.path.endswith(".kind")}
    for row in parameters():
        if not row.path.endswith(".kind"):
            assert f"| `{row.path}` | `{row.default}` | {row.text.replace('|', chr(92) + '|')} |" in shown, row.path
    assert {kind for kind in kinds if f".kind = {kind}`" in shown} == kinds - {"shared", "separate"}
    assert "controller.model.kind" in shown


def test_every_metric_array_and_status_is_on_its_page() -> None:
    shown = shown_on("metrics.md")
    for metric in METRICS:
        assert f"`{metric.key.partition('.')[2]}`" in shown
        assert metric.definition.replace("|", "\\|") in shown
    for array in SERIES:
        assert f"| `{array.name}` | {array.unit} |" in shown
    for status in STATUSES:
        assert f"| `{status}` |" in shown


@pytest.mark.slow
def test_every_operation_is_on_the_page_of_the_api() -> None:
    shown = shown_on("http_api.md")
    paths = program("page_tables.interfaces").openapi()["paths"]
    assert len(paths) > 40
    for path, methods in paths.items():
        for method in methods:
            assert f"| `{method.upper()} {path}` |" in shown


def test_every_command_is_on_its_page() -> None:
    shown = shown_on("commands.md")
    for command in ("needlebench serve", "needlebench campaign run", "needlebench key create", "needlebench bench"):
        assert f"# {command}\n" in shown


def test_scores_of_the_paper_are_those_of_the_report() -> None:
    shown = program("page_tables").part("paper scores").splitlines()
    report = json.loads((RESULTS / "paper" / "report.json").read_text())
    score = next(s for s in report["scores"] if (s["group"], s["arm"], s["noise"]) == ("CUR", "elm", "off"))
    curved = next(number for number, line in enumerate(shown) if line.startswith("| CUR"))
    row = next(cells(line) for line in shown[curved:] if "ELM" in line)
    assert row[2] == str(score["insertions"])
    assert row[3] == f"{100 * score['stable']:g}\u00a0%"
    assert float(row[4]) == pytest.approx(score["median_mm"], abs=5e-4)
    with (RESULTS / "paper" / "insertions.csv").open(newline="") as file:
        stable = [
            float(line["rcm_max_mm"])
            for line in csv.DictReader(file)
            if (line["group"], line["arm"], line["young"], line["purpose"]) == ("CUR", "elm", "constant", "main")
            and line["stable"] == "yes"
        ]
    assert row[9] == f"{statistics.median(stable):.2f}"


def test_every_claim_has_the_verdict_of_the_report() -> None:
    claims = program("page_tables").part("paper claims")
    shown = re.findall(r"\* \*\*(.+?)\.\*\*", claims)
    report = json.loads((RESULTS / "paper" / "report.json").read_text())["claims"]
    assert [verdict.lower() for verdict in shown] == [claim["verdict"] for claim in report]
    counted = program("page_tables").part("verdicts")
    for verdict, count in Counter(claim["verdict"] for claim in report).items():
        assert f"{count} {verdict}" in counted


def test_what_the_page_says_of_the_rerun_can_be_counted_again() -> None:
    text = " ".join((DOCS / "results.md").read_text().split())
    with (RESULTS / "paper" / "insertions.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    report = json.loads((RESULTS / "paper" / "report.json").read_text())
    first, second = report["provenance"]["insertions_by_commit"].values()
    assert f"{len(rows):,} insertions at the scale `full`" in text
    assert f"{first:,} of commit b58d6d3 on 2026-11-30, and {second:,} of 37eaf59" in text
    failed = [row for row in rows if row["status"] != "completed"]
    quiet = [row for row in rows if row["arm"] == "elm_quiet"]
    lost = [row for row in quiet if row["status"] != "completed"]
    other = sorted((row["purpose"], row["value"]) for row in failed if row["arm"] != "elm_quiet")
    assert other == [("seeds", ""), ("sensitivity", "no target noise")]
    assert f"Of all others {len(failed)} did: {len(lost)} of {len(quiet)} of the ELM" in text
    assert f"reaches {sum(row['success'] == 'yes' for row in quiet)} of its end points" in text
    main = [row for row in rows if row["purpose"] == "main" and row["arm"] in ("ifem", "elm")]
    curved = {
        arm: [row for row in main if (row["group"], row["arm"], row["young"]) == ("CUR", arm, "constant")]
        for arm in ("ifem", "elm")
    }
    stress = {arm: [float(row["max_needle_stress_mpa"]) for row in found] for arm, found in curved.items()}
    reached = [f"{max(stress[arm]):.0f}" for arm in stress], [f"{statistics.median(stress[arm]):.0f}" for arm in stress]
    assert f"reaches {reached[0][0]} MPa at most and {reached[1][0]} in the middle" in text
    assert f"the ELM {reached[0][1]} and {reached[1][1]}" in text
    largest = max(float(row["rmse_commanded_mm"]) for row in curved["ifem"])
    assert f"the largest RMSE of I-FEM's 400 insertions is {largest:.3f} mm" in text
    assert all(one["clusters_below"] == one["clusters"] == 100 for one in report["directions"])
    assert f"{min(float(row['min_det_f']) for row in main):.1f}" == "0.9"
    seeds = {one["group"]: one for one in report["seeds"]["shares"]}
    lin, cur = ([f"{seeds[group][key]:.3f}" for key in ("low_mm", "high_mm")] for group in ("LIN", "CUR"))
    assert f"medians of {lin[0]} to {lin[1]} mm and {cur[0]} to {cur[1]}" in text


def test_both_meshes_are_compared_along_the_same_paths() -> None:
    lines = [cells(line) for line in program("page_tables").part("paper meshes").splitlines()]
    assert [line[0] for line in lines[2:]] == ["LIN", "CUR"]
    assert all(re.fullmatch(r"20 / 20 of 20", line[5]) for line in lines[2:])


def test_what_the_settling_experiment_found_is_what_its_report_says() -> None:
    report = json.loads((RESULTS / "settling" / "settling.json").read_text())
    text = " ".join((DOCS / "settling.md").read_text().split())
    counts = Counter(one["claim"]["verdict"] for one in report["planned"])
    assert counts == {"reproduced": 8, "not reproduced under our assumptions": 1, "undecided": 7}
    assert "*reproduced* in 8 of the 16 planned comparisons" in text
    late = [one for one in report["planned"] if one["second"].split("-")[2] == "20ms"]
    assert {one["claim"]["verdict"] for one in late} == {"reproduced"}
    punctual = [one for one in report["planned"] if one not in late and one["budget"]["difference_mm"] > 0.0]
    assert len(punctual) == 7
    for group in (late, punctual):
        change = [abs(one["budget"]["difference_mm"]) for one in group]
        digits = 2 if group is late else 3
        assert f"by {min(change):.{digits}f} to {max(change):.{digits}f} mm" in text
        assert {one["budget"]["clusters"] for one in group} == {20}
        assert {max(one["budget"]["clusters_below"], one["budget"]["clusters_above"]) for one in group} == {20}


def test_golden_numbers_arrive() -> None:
    golden = json.loads((RESULTS / "builtin_scenarios.json").read_text())["cases"]
    shown = [cells(line) for line in program("page_tables").part("built-in scenarios").splitlines()]
    demo = next(row for row in shown if row[0] == "`demo`")
    assert demo[2] == f"{golden['demo']['metrics']['rmse_commanded_mm']:.4f}"
    push = shown[0].index("Push N")
    assert demo[push] == f"{golden['demo']['metrics']['max_push_n']:.2f}"


def test_a_table_escapes_its_bars() -> None:
    table = program("page_tables.markdown").table
    assert table(("a", "b"), [("|x|", "1")], numbers=(1,)) == "| a | b |\n| --- | ---: |\n| \\|x\\| | 1 |"


@pytest.mark.parametrize(("ratio", "text"), [(1.0, "0"), (1.0004, "0"), (0.9, "−10"), (1.152, "+15"), (1.0056, "+0.6")])
def test_changes_in_per_cent(ratio: float, text: str) -> None:
    assert program("page_tables.markdown").signed_percent(ratio) == f"{text}\u00a0%"
