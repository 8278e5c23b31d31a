"""Campaigns in a folder: each insertion kept at once and once, half a line taken off, one table in the end."""

from __future__ import annotations

import hashlib
import json
from typing import TYPE_CHECKING, Any

import pytest
from click.testing import CliRunner
from pyarrow import parquet

from benchmarks.cases import Case, Outcome, Suite
from service.cli.main import main
from service.local.campaign_folder import OUTCOMES, CampaignFolder, open_campaign_folder, series_path, stored_lines
from service.local.campaign_table import write_table
from service.local.insertion_sets import insertions_in
from service.worker.crew import crashed
from simcore.errors import ScenarioError

if TYPE_CHECKING:
    from pathlib import Path

REQUEST = {"name": "few", "grid": {}}


def suite(count: int = 3) -> Suite:
    return Suite(
        "few", "", tuple(Case(f"case {i}", {"seed": i}, {"arm": "ifem", "end_point": i}) for i in range(count))
    )


def outcome(case: Case, **more: Any) -> Outcome:
    result = {
        "status": "completed",
        "message": "",
        "digest": f"digest {case.id}",
        "metrics": {"success": True, "rmse_mm": 1, "note": None},
        "timing": {"total_s": 0.5},
        "cost": {"cpu_s": 1.5, "attempts": 2},
        "warnings": ["the needle would yield"],
        "provenance": {"scenario": case.scenario, "cpu": "A processor", "blas_core": "Haswell", "commit": "c"},
    }
    return Outcome(case, {**result, **more})


def keep(folder: CampaignFolder, one: Outcome) -> None:
    (folder.incoming / f"{one.case.id}.npz").write_text(f"series of {one.case.id}")
    folder.keep(one)


def test_an_insertion_is_kept_once_with_its_series_by_content(tmp_path: Path) -> None:
    few = suite()
    with open_campaign_folder(tmp_path / "c", few, REQUEST) as folder:
        keep(folder, outcome(few.cases[0]))
        keep(folder, outcome(few.cases[0], status="another attempt"))
        keep(folder, outcome(few.cases[1]))
    lines = list(stored_lines(tmp_path / "c"))
    assert [line["id"] for line in lines] == ["case 0", "case 1"]
    assert lines[0]["result"]["status"] == "completed"
    sha256 = hashlib.sha256(b"series of case 0").hexdigest()
    assert lines[0]["series_sha256"] == sha256
    assert series_path(tmp_path / "c", sha256).read_text() == "series of case 0"
    with open_campaign_folder(tmp_path / "c", few, REQUEST) as folder:
        assert folder.finished == {"case 0", "case 1"}
    found = insertions_in(tmp_path / "c")
    assert [one.case.scenario for one in found.outcomes] == [{"seed": 0}, {"seed": 1}]
    assert found.suite == "few"
    assert found.series_sha256("case 0") == sha256


def test_half_a_line_is_taken_off_and_run_again(tmp_path: Path) -> None:
    few = suite()
    with open_campaign_folder(tmp_path / "c", few, REQUEST) as folder:
        keep(folder, outcome(few.cases[0]))
    whole = (tmp_path / "c" / OUTCOMES).read_bytes()
    (tmp_path / "c" / OUTCOMES).write_bytes(whole + whole[:100])
    with open_campaign_folder(tmp_path / "c", few, REQUEST) as folder:
        assert folder.finished == {"case 0"}
        keep(folder, outcome(few.cases[1]))
    assert [line["id"] for line in stored_lines(tmp_path / "c")] == ["case 0", "case 1"]
    (tmp_path / "c" / OUTCOMES).write_bytes(b"no json\n")
    with pytest.raises(ScenarioError, match=r"outcomes\.jsonl, whose line 1 is unreadable"):
        insertions_in(tmp_path / "c")


def test_another_campaign_another_commit_and_other_files_are_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with (
        open_campaign_folder(tmp_path / "c", suite(), REQUEST),
        pytest.raises(ScenarioError, match="is in use by process"),
        open_campaign_folder(tmp_path / "c", suite(), REQUEST),
    ):
        pass
    with (
        pytest.raises(ScenarioError, match=r"holds another campaign \(few, suite_sha256 differs\)"),
        open_campaign_folder(tmp_path / "c", suite(4), REQUEST),
    ):
        pass
    monkeypatch.setattr("service.local.campaign_folder.commit", lambda: "another")
    with (
        pytest.raises(ScenarioError, match="and not another; choose"),
        open_campaign_folder(tmp_path / "c", suite(), REQUEST),
    ):
        pass
    with open_campaign_folder(tmp_path / "c", suite(), REQUEST, any_commit=True):
        pass
    (tmp_path / "d").mkdir()
    (tmp_path / "d" / "mine.txt").touch()
    with (
        pytest.raises(ScenarioError, match="belong to no campaign"),
        open_campaign_folder(tmp_path / "d", suite(), REQUEST),
    ):
        pass
    assert [path.name for path in (tmp_path / "d").iterdir()] == ["mine.txt"]


def test_the_table_has_processor_kernels_and_warnings_of_each_row(tmp_path: Path) -> None:
    few = suite()
    with open_campaign_folder(tmp_path / "c", few, REQUEST) as folder:
        keep(folder, outcome(few.cases[0]))
        keep(folder, outcome(few.cases[1], metrics={"success": False, "rmse_mm": 0.25, "note": None}, warnings=[]))
        folder.keep(crashed(few.cases[2], "ValueError: no good"))
    table = parquet.read_table(write_table(tmp_path / "c"))
    rows = {row["case"]: row for row in table.to_pylist()}
    assert len(rows) == table.num_rows == 3
    assert rows["case 0"]["cpu"] == "A processor"
    assert rows["case 0"]["blas_core"] == "Haswell"
    assert rows["case 0"]["warnings"] == ["the needle would yield"]
    assert rows["case 0"]["cost_attempts"] == 2
    assert (rows["case 0"]["rmse_mm"], rows["case 1"]["rmse_mm"]) == (1.0, 0.25)  # one type for both
    assert rows["case 0"]["success"] is True
    assert json.loads(rows["case 1"]["scenario"]) == {"seed": 1}
    assert (rows["case 2"]["status"], rows["case 2"]["message"]) == ("crashed", "ValueError: no good")
    assert rows["case 2"]["digest"] is rows["case 2"]["series_sha256"] is None
    about = json.loads(table.schema.metadata[b"campaign"])
    assert about["suite_sha256"] == few.sha256


def test_options_of_a_service_are_not_for_a_folder(tmp_path: Path) -> None:
    arguments = ["campaign", "run", "lin100-v2-smoke", "--out", str(tmp_path / "c")]
    result = CliRunner().invoke(main, [*arguments, "--csv", str(tmp_path / "t.csv")])
    assert result.exit_code == 2
    assert "--csv" in result.output
    assert "not for --out DIR" in result.output
    result = CliRunner().invoke(main, [*arguments, "--dry-run"])
    assert result.exit_code == 0
    assert "insertions" in result.output
    assert not (tmp_path / "c").exists()
