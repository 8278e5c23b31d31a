"""`needlebench paper` as a process: killed, continued, refused, repeated. Real insertions in a very coarse block."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from typing import TYPE_CHECKING, Any

import pytest
from click.testing import CliRunner

from benchmarks.cases import Case, Outcome
from benchmarks.paper.plan import Plan
from benchmarks.paper.scale import SCALES, Scale
from benchmarks.paper.suites import resolve_cases
from benchmarks.suites.catalogue import drafts
from service.cli.main import main
from service.cli.paper import read_scale
from service.local.paper_folder import PaperFolder, open_folder
from service.local.paper_run import enough_space, identity
from service.worker.crew import Crew
from simcore.errors import ScenarioError

if TYPE_CHECKING:
    from pathlib import Path

TINY = {
    "name": "tiny",
    "element_size_mm": 20.0,
    "dt_s": 0.05,
    "training": 3,
    "retraining": 2,
    "quiet": 1,
    "samples": 300,
    "seeds": 1,
    "lin": 2,
    "cur": 1,
    "young": 0,
    "reference_lin": 1,
    "reference_cur": 1,
    "reference_young": 0,
    "noise": 0,
    "baselines": 0,
    "seed_paths": 0,
    "timing": 1,
    "sensitivity_lin": 0,
    "sensitivity_cur": 0,
    "curve_nodes": [5],
    "curve_samples": [100],
    "recordings": 0,
}
PATIENCE_S = 600.0


def command(folder: Path) -> list[str]:
    scale = folder.with_name("tiny.json")
    scale.write_text(json.dumps(TINY))
    words = [
        sys.executable,
        "-m",
        "service.cli",
        "paper",
        "--scale",
        str(scale),
        "--out",
        str(folder),
        "--any-commit",
    ]
    return [*words, "--workers", "2"]


def results(folder: Path) -> dict[str, Any]:
    """id -> (stored result, when it was written)."""
    return {p.stem: (json.loads(p.read_text()), p.stat().st_mtime_ns) for p in (folder / "results").glob("*.json")}


def stopped_after(folder: Path, number: int, how: signal.Signals) -> int:
    """Start the command and signal it once that many results are there; its exit code."""
    process = subprocess.Popen(command(folder), stderr=subprocess.DEVNULL, stdout=subprocess.DEVNULL)
    deadline = time.monotonic() + PATIENCE_S
    while not (folder / "results").exists() or len(list((folder / "results").glob("*.json"))) < number:
        assert process.poll() is None, "it ended by itself"
        assert time.monotonic() < deadline
        time.sleep(0.02)
    os.kill(process.pid, how)
    return process.wait(PATIENCE_S)


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="kills by signal")
def test_a_killed_run_goes_on_where_it_was(tmp_path: Path) -> None:
    folder = tmp_path / "run"
    assert stopped_after(folder, 2, signal.SIGKILL) == -signal.SIGKILL  # in the data set
    first = results(folder)
    assert stopped_after(folder, 6, signal.SIGINT) == 130  # in the experiments
    second = results(folder)
    done = subprocess.run(command(folder), capture_output=True, text=True, timeout=PATIENCE_S, check=False)
    assert done.returncode == 0, done.stderr
    final = results(folder)
    assert {name: final[name] for name in first} == first
    assert {name: final[name] for name in second} == second
    assert len(final) == Plan(Scale.model_validate_json(json.dumps(TINY))).insertions
    assert not list(folder.rglob(".*.tmp"))
    assert done.stdout.splitlines()[-1] == str(folder / "report.html")
    check_report(folder, len(final))


def check_report(folder: Path, insertions: int) -> None:
    report = json.loads((folder / "report.json").read_text())
    assert report["provenance"]["insertions"] == insertions
    assert "<html" in (folder / "report.html").read_text()
    assert len((folder / "insertions.csv").read_text().splitlines()) == insertions + 1
    assert len((folder / "predictions.csv").read_text().splitlines()) > 3
    recordings = {path.stem for path in (folder / "recordings").glob("*.rrd")}
    stored = results(folder)
    assert recordings
    assert recordings <= set(stored)
    for case_id in recordings:
        assert stored[case_id][0]["result"]["digest"]


@pytest.mark.slow
def test_the_smoke_suite_run_twice_is_bit_identical(tmp_path: Path) -> None:
    wanted = {"lin-000-ifem", "lin-000-open_loop", "lin-noise-000-ifem", "cur-000+x-ifem", "cur-001-x-rigid"}
    cases = resolve_cases([case for case in drafts("paper-v2-smoke") if case.id in wanted])
    assert len(cases) == len(wanted)
    with Crew(2, folder=tmp_path, files=tmp_path) as crew:
        runs = [{o.case.id: o.result for o in crew.run_many(order)} for order in (cases, cases[::-1])]
    for name in wanted:
        once, again = (run[name] for run in runs)
        assert once["status"] == "completed"
        assert (once["metrics"], once["digest"]) == (again["metrics"], again["digest"])


# ---- folders


def plan(**changes: Any) -> Plan:
    return Plan(Scale.model_validate_json(json.dumps({**TINY, **changes})))


def content(folder: Path) -> dict[str, bytes]:
    return {str(p.relative_to(folder)): p.read_bytes() for p in folder.rglob("*") if p.is_file()}


def test_a_run_is_extended_to_another_scale_and_keeps_what_it_has(tmp_path: Path) -> None:
    folder = tmp_path / "run"
    (case, *_) = resolve_cases([case for case in plan().stages[2].cases if case.id == "lin-000-ifem"])
    with open_folder(folder, identity(plan())) as first:
        first.keep(Outcome(case, {"status": "completed", "provenance": {"scenario": case.scenario}}))
    for _ in range(2):
        with open_folder(folder, identity(plan(lin=5, name="more")), extend=True) as more:
            assert more.finished(case) is not None
    assert json.loads((folder / "run.json").read_text())["scale"]["name"] == "more"
    with pytest.raises(ScenarioError, match="scale more, scale differs"):
        open_folder(folder, identity(plan())).__enter__()


def test_a_run_without_a_training_study_is_extended_by_one_and_a_study_by_no_other(tmp_path: Path) -> None:
    folder = tmp_path / "run"
    with open_folder(folder, identity(plan(retraining=0, quiet=0))):
        pass
    with open_folder(folder, identity(plan(retraining=2)), extend=True):
        pass
    with pytest.raises(ScenarioError, match=r"retraining differs\); choose another folder$"):
        open_folder(folder, identity(plan(retraining=3)), extend=True).__enter__()


def test_a_folder_of_another_run_is_refused_and_left_alone(tmp_path: Path) -> None:
    folder = tmp_path / "run"
    with open_folder(folder, identity(plan())):
        pass
    before = content(folder)
    with pytest.raises(ScenarioError, match=r"--out = .* holds another run \(scale tiny, scale differs\)"):
        open_folder(folder, identity(plan(lin=1))).__enter__()
    with pytest.raises(ScenarioError, match=r"was started by commit .* and not other.*--any-commit"):
        open_folder(folder, {**identity(plan()), "commit": "other"}).__enter__()
    with (
        open_folder(folder, {**identity(plan()), "commit": "other"}, any_commit=True),
        pytest.raises(ScenarioError, match="is in use by"),
    ):
        open_folder(folder, identity(plan())).__enter__()
    with pytest.raises(ScenarioError, match=r"\(scale tiny, samples differs\); choose another folder$"):
        open_folder(folder, identity(plan(samples=200)), extend=True).__enter__()
    del before[".lock"]
    assert {name: data for name, data in content(folder).items() if name != ".lock"} == before


def test_a_folder_with_something_else_is_refused(tmp_path: Path) -> None:
    (tmp_path / "thesis.tex").write_text("mine")
    with pytest.raises(ScenarioError, match="holds files that belong to no run of the paper"):
        open_folder(tmp_path, identity(plan())).__enter__()
    assert content(tmp_path) == {"thesis.tex": b"mine"}


def test_a_result_counts_for_its_own_scenario_only(tmp_path: Path) -> None:
    case = Case("lin-000-ifem", {"seed": 1}, {"arm": "ifem"})
    other = Case("lin-000-ifem", {"seed": 2}, {"arm": "ifem"})
    with open_folder(tmp_path / "run", identity(plan())) as folder:
        assert folder.finished(case) is None
        folder.keep(Outcome(case, {"status": "completed", "provenance": {"scenario": case.scenario}}))
        assert folder.finished(case) is not None
        assert folder.finished(other) is None
        (folder.path / "results" / "lin-000-ifem.json").write_text('{"id": "lin')
        with pytest.raises(ScenarioError, match=r"results/lin-000-ifem.json, which is unreadable"):
            folder.finished(case)


def test_finished_cases_are_not_run_again(tmp_path: Path) -> None:
    cases = [Case(f"case-{i}", {"seed": i}, {}) for i in range(4)]
    asked: list[list[str]] = []

    def run_many(left: Any) -> Any:
        asked.append([case.id for case in left])
        return [Outcome(case, {"status": "completed", "provenance": {"scenario": case.scenario}}) for case in left]

    with open_folder(tmp_path / "run", identity(plan())) as folder:
        assert isinstance(folder, PaperFolder)
        first = list(folder.cached(run_many)(cases[:2]))
        second = list(folder.cached(run_many)(cases))
    assert asked == [["case-0", "case-1"], ["case-2", "case-3"]]
    assert second[:2] == first
    assert [outcome.case.id for outcome in second] == [case.id for case in cases]


def test_a_full_disk_is_refused_before_anything_is_made(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    usage = shutil.disk_usage(tmp_path)
    monkeypatch.setattr(shutil, "disk_usage", lambda _: usage._replace(free=1_000_000))
    with pytest.raises(ScenarioError, match=r"--out = .*needs about \d+ MB and some to spare, 1 MB are free"):
        enough_space(plan(), tmp_path / "deep" / "run")
    assert not list(tmp_path.iterdir())


def test_whatever_is_needed_is_looked_at_before_anything_is_made(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refused(*more: str) -> str:
        done = CliRunner().invoke(main, ["paper", "--scale", "smoke", "--out", str(tmp_path / "run"), *more])
        assert done.exit_code in (1, 2)
        assert not list(tmp_path.iterdir())
        return done.stderr

    with monkeypatch.context() as patch:
        patch.setattr("service.local.paper_run.available_mb", lambda: 1000.0)
        assert "--workers = 64: need about 22400 MB of memory, 1000 MB are available" in refused("--workers", "64")
    with monkeypatch.context() as patch:
        patch.setitem(sys.modules, "sklearn", None)
        assert "training the mlp needs scikit-learn: pip install" in refused()
    with monkeypatch.context() as patch:
        patch.setattr(os, "access", lambda *_: False)
        assert "is not writable for this user" in refused()


# ---- the command


def test_a_scale_that_is_none_is_refused(tmp_path: Path) -> None:
    wrong = tmp_path / "wrong.json"
    wrong.write_text(json.dumps({"name": "mine", "lin": 1000}))
    for scale, message in (("huge", "is neither a file nor one of smoke, quick"), (str(wrong), "lin = 1000")):
        done = CliRunner().invoke(main, ["paper", "--scale", scale, "--out", str(tmp_path / "out")])
        assert done.exit_code == 2
        assert message in done.stderr
    assert not (tmp_path / "out").exists()


def test_a_printed_scale_can_be_read(tmp_path: Path) -> None:
    done = CliRunner().invoke(main, ["paper", "--scale", "quick", "--fields"])
    assert done.exit_code == 0
    file = tmp_path / "mine.json"
    file.write_text(done.stdout)
    assert read_scale(str(file), SCALES) == SCALES["quick"]
