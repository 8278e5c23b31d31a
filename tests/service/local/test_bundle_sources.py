"""What a bundle is made of: models, code of others, other processes, experiments, campaigns."""

from __future__ import annotations

import hashlib
import json
import sys
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from benchmarks.bundles.check import open_bundle
from service.client.campaign_insertions import download_campaign
from service.local.bundle_making import Chosen, draft_bundle
from simcore.errors import ScenarioError
from tests.service.learned import model_bytes
from tests.service.local.bundled import made, needlebench, runs_in, sealed

if TYPE_CHECKING:
    from pathlib import Path

    pass


# ---- files, code, other processes


@pytest.mark.slow
def test_a_model_travels_and_where_it_lay_does_not(tmp_path: Path) -> None:
    (private := tmp_path / "Jane Doe").mkdir()
    (private / "mine.json").write_bytes(model_bytes("elm"))
    runs = runs_in(tmp_path / "runs", {"kind": "elm", "model": str(private / "mine.json")})
    made(runs, tmp_path / "b.zip", "--sample", "1")
    assert b"Jane Doe" not in (tmp_path / "b.zip").read_bytes()
    with open_bundle(tmp_path / "b.zip") as opened:
        (named,) = opened.manifest.named_files
        assert (opened.manifest.renamed, opened.records[0].scenario["controller"]["model"]) == (1, named.name)
    (private / "mine.json").unlink()
    told = needlebench("bundle", "verify", tmp_path / "b.zip")
    assert (told.exit_code, "1 identical" in told.output) == (0, True), told.output
    (runs / "bundled" / "run 0.npz").unlink()
    told = needlebench("bundle", "make", runs, "--out", tmp_path / "c.zip")
    assert (told.exit_code, "is not here any more" in told.output) == (2, True)


PLUGIN = """
from pathlib import Path
Path(r"{mark}").write_text("ran")
import numpy as np

class Still:
    def __init__(self, scenario, entry_m, length_m, settings):
        self.table = Path(settings["table"]).read_text()
    def command(self, seen):
        return seen.base
"""


@pytest.fixture
def plugin_bundle(tmp_path: Path) -> Path:
    """Of a plug-in that this process does not have, and that leaves a mark where it is imported."""
    from simcore import plugins
    from simcore.controller_code import Code, digest_of_files, file_sha256

    module, mark, table = tmp_path / "still_here.py", tmp_path / "mark", tmp_path / "table.txt"
    module.write_text(PLUGIN.format(mark=mark))
    table.write_text("1")
    code = Code(None, digest_of_files([(module.name, file_sha256(module))]))
    sys.path.insert(0, str(tmp_path))
    try:
        factory = __import__("still_here").Still
    finally:
        sys.path.remove(str(tmp_path))
    with plugins.registered("still", factory, code):
        controller = {"kind": "plugin", "name": "still", "settings": {"table": str(table)}}
        runs = runs_in(tmp_path / "runs", controller)
    told = needlebench("bundle", "make", runs, "--out", tmp_path / "b.zip", "--sample", "1")
    assert (told.exit_code, "--source still=FILE.py:FACTORY" in told.output) == (2, True), told.output
    made(runs, tmp_path / "b.zip", "--sample", "1", "--source", f"still={module}:Still")
    table.unlink()
    module.unlink()
    mark.unlink()
    return tmp_path / "b.zip"


@pytest.mark.slow
def test_code_in_a_bundle_runs_only_when_asked_for(plugin_bundle: Path) -> None:
    mark = plugin_bundle.with_name("mark")
    assert needlebench("bundle", "check", plugin_bundle).exit_code == 0
    told = needlebench("bundle", "verify", plugin_bundle)
    assert told.exit_code == 3
    assert "--run-plugin-code executes the code in the bundle" in told.output
    assert not mark.exists()
    told = needlebench("bundle", "verify", plugin_bundle, "--run-plugin-code")
    assert (told.exit_code, "identical  run 0" in told.output) == (0, True), told.output
    assert mark.read_text() == "ran"
    assert "still_here" not in sys.modules


@pytest.mark.slow
def test_source_that_is_not_the_code_that_ran_is_refused(plugin_bundle: Path, tmp_path: Path) -> None:
    with open_bundle(plugin_bundle) as opened:
        manifest = opened.manifest
        (arm,) = manifest.arms
        assert arm.source is not None
        files = {one.name: b"".join(opened.archive.chunks(one.name)) for one in manifest.files}
    entry = arm.source[0].entry
    assert entry is not None
    lie = sealed(manifest, {**files, entry: files[entry] + b"# edited\n"}, tmp_path / "lie.zip")
    told = needlebench("bundle", "check", lie)
    assert f"{entry} is not the file that belongs to the code of controller 'still'" in told.output


def test_a_controller_in_another_process_makes_an_open_bundle(folder: Path, tmp_path: Path) -> None:
    """Such a result is one of the folder whose arm says so; its connection is nobody's business."""
    stored = json.loads((folder / "run 1" / "result.json").read_text())
    block = {"kind": "remote", "name": "theirs", "address": "unix:/run/jane/s.sock", "settings": {}, "delay_s": 0.0}
    arm: dict[str, Any] = {
        "kind": "remote",
        "controller": "theirs",
        "settings": {},
        "version": None,
        "code_sha256": None,
        "files": {},
    }
    stored["provenance"]["scenario"]["controller"] = block
    stored["provenance"]["arm"] = arm
    (tmp_path / "runs" / "theirs").mkdir(parents=True)
    (tmp_path / "runs" / "theirs" / "result.json").write_text(json.dumps(stored))
    made(tmp_path / "runs", tmp_path / "b.zip", "--sample", "1")
    assert b"jane" not in (tmp_path / "b.zip").read_bytes()
    with open_bundle(tmp_path / "b.zip") as opened:
        assert (opened.manifest.division, opened.manifest.chosen.cases) == ("open", [])
    told = needlebench("bundle", "verify", tmp_path / "b.zip")
    assert (told.exit_code, "whose code is not in the bundle (open division)" in told.output) == (3, True)


def experiment(folder: Path, runs: Path) -> Path:
    """The folder of an experiment, as `needlebench paper` leaves it: reduced series, and a result for each case."""
    (folder / "results").mkdir(parents=True)
    (folder / "series").mkdir()
    about = {"schema": "needlebench/paper/3", "scale": {"name": "tiny"}, "plan_sha256": "0" * 64, "commit": None}
    (folder / "run.json").write_text(json.dumps(about))
    for number, name in enumerate(("lin-000-ifem", "lin-000-open_loop")):
        result = json.loads((runs / f"run {number}" / "result.json").read_text())
        labels = {"group": "LIN", "arm": name.rpartition("-")[2], "end_point": 0, "direction": ""}
        stored = {"id": name, "labels": labels, "result": {**result, "cost": {"cpu_s": 1.0}}}
        (folder / "results" / f"{name}.json").write_text(json.dumps(stored))
        np.savez(folder / "series" / f"{name}.npz", tip_m=np.zeros((2, 3), "f4"))
    return folder


def test_an_experiment_has_its_labels_and_digests_of_its_series(folder: Path, tmp_path: Path) -> None:
    made(experiment(tmp_path / "paper", folder), tmp_path / "b.zip", "--sample", "1")
    with open_bundle(tmp_path / "b.zip") as opened:
        manifest, records = opened.manifest, opened.records
    assert manifest.suite.name == "needlebench/paper/3, scale tiny"
    assert [record.labels["arm"] for record in records] == ["ifem", "open_loop"]
    file = tmp_path / "paper" / "series" / "lin-000-ifem.npz"
    assert records[0].series_sha256 == hashlib.sha256(file.read_bytes()).hexdigest()
    assert "cost" not in records[0].result
    assert len(manifest.chosen.cases) == 1
    told = needlebench("dataset", "--from", tmp_path / "paper", "--out", tmp_path / "d.npz")
    assert "none of 2 insertions left a series with all variables" in told.output


class Campaign:
    """What the client says of a campaign whose jobs are the runs of a folder."""

    def __init__(self, runs: Path, **changes: Any) -> None:
        self.runs = runs
        self.terminal, self.state, self.ended, self.cases = True, "done", 2, 2
        self.suite, self.raw, self.lost = "grid", {"suite_sha256": None}, False
        self.__dict__ |= changes

    def campaign(self, _: str) -> Campaign:
        return self

    def campaign_cases(self, _: str) -> list[dict[str, Any]]:
        return [{"case": f"case {i}", "labels": {}, "job": None if self.lost else str(i)} for i in range(2)]

    def job(self, job_id: str) -> Any:
        result = json.loads((self.runs / f"run {job_id}" / "result.json").read_text())
        scenario = result["provenance"]["scenario"]
        if job_id == "1":
            return SimpleNamespace(
                state="failed", scenario=scenario, result=None, error={"kind": "crashed", "message": "m"}
            )
        return SimpleNamespace(state="finished", scenario=scenario, result=result, error=None)

    def artefacts(self, job_id: str) -> list[dict[str, Any]]:
        return [{"kind": "series", "sha256": "5" * 64}] if job_id == "0" else []


def test_a_campaign_is_whole_or_no_bundle(folder: Path, tmp_path: Path) -> None:
    def download(**changes: Any) -> Any:
        return download_campaign(Campaign(folder, **changes), "c", tmp_path)  # type: ignore[arg-type]

    with pytest.raises(ScenarioError, match="is running: 2 of 2 jobs have ended"):
        download(terminal=False, state="running")
    with pytest.raises(ScenarioError, match="the job of case case 0 was deleted"):
        download(lost=True)
    draft = draft_bundle(download(), Chosen(2, 0), (), lambda _: None)
    assert draft.manifest.failed == 1
    assert draft.manifest.chosen.cases == ["case 0"]
    draft.write(tmp_path / "b.zip")
    with open_bundle(tmp_path / "b.zip") as opened:
        assert [record.series_sha256 for record in opened.records] == ["5" * 64, None]
        assert opened.records[1].result["status"] == "crashed"


@pytest.mark.parametrize("content", [None, "{", '{"digest": 1}'], ids=["none", "cut off", "no result"])
def test_a_folder_without_results_is_refused(tmp_path: Path, content: str | None) -> None:
    if content is not None:
        (tmp_path / "result.json").write_text(content)
    told = needlebench("bundle", "make", tmp_path, "--out", tmp_path / "b.zip")
    assert (told.exit_code, "FOLDER = " in told.output) == (2, True)
    assert not (tmp_path / "b.zip").exists()
