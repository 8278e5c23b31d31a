"""The scripts for Slurm: checked by shellcheck, and run through an sbatch that starts their processes here."""

from __future__ import annotations

import json
import os
import shutil
import signal
import stat
import subprocess
import sys
from typing import TYPE_CHECKING

import pytest
from click.testing import CliRunner

from benchmarks.cases import Case
from service.cli.main import main
from service.cluster.address import ClusterAddress
from service.cluster.crew import ClusterCrew
from service.cluster.slurm import SlurmCluster
from simcore.errors import ScenarioError
from tests.acceptance.server import ROOT, until

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

FAKE = ROOT / "tests" / "data" / "slurm"
OPTIONS = ("--cores", "16", "--option", "--partition=long", "--interface", "ib0", "--memory", "1500")
SCRIPTS = ("scheduler.sbatch", "workers.sbatch", "start.sh")
linux = pytest.mark.skipif(sys.platform != "linux", reason="needs sh and signals")


def written(folder: Path, *more: str) -> Path:
    arguments = ["cluster", "slurm", "--out", str(folder), "--nodes", "2", "--time", "2h", *more]
    result = CliRunner().invoke(main, arguments)
    assert result.exit_code == 0, result.output
    assert f"sh {folder}/start.sh" in result.output
    return folder


@pytest.mark.slow
def test_the_scripts_say_what_was_asked_for(tmp_path: Path) -> None:
    folder = written(tmp_path / "a cluster", *OPTIONS)
    workers, scheduler = (folder / "workers.sbatch").read_text(), (folder / "scheduler.sbatch").read_text()
    for line in ("--nodes=2", "--ntasks-per-node=16", "--time=120", "--mem-per-cpu=1500M", "--partition=long"):
        assert f"#SBATCH {line}\n" in workers
    assert "--lifetime 6600s" in workers  # ten minutes before the end nothing new begins
    assert f"'file:{folder}/scheduler.json'" in workers
    assert "--interface ib0" in scheduler
    assert set(json.loads((folder / "cluster.json").read_text())["identity"]) >= {"commit", "lock", "numpy", "code"}
    assert stat.S_IMODE(folder.stat().st_mode) == 0o700
    assert stat.S_IMODE((folder / "tls" / "key.pem").stat().st_mode) == 0o600


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("shellcheck") is None, reason="needs shellcheck")
@pytest.mark.parametrize("options", [(), OPTIONS])
def test_shellcheck_has_no_objection(tmp_path: Path, options: tuple[str, ...]) -> None:
    folder = written(tmp_path / "a cluster; rm", *options)
    found = subprocess.run(
        ["shellcheck", *(str(folder / name) for name in SCRIPTS), str(FAKE / "srun")],
        capture_output=True,
        text=True,
        check=False,
    )
    assert found.returncode == 0, found.stdout


def test_options_of_sbatch_are_one_line_each(tmp_path: Path) -> None:
    with pytest.raises(ScenarioError, match="must be an option of sbatch"):
        SlurmCluster(folder=tmp_path, nodes=1, cores=1, time_s=60, lines=("--a=b\nrm -rf /",))
    with pytest.raises(ScenarioError, match="must be a name without quotes"):
        SlurmCluster(folder=tmp_path / "50 %", nodes=1, cores=1, time_s=60)


@pytest.fixture
def slurm(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """Where the fake Slurm keeps its jobs, which end with the test."""
    jobs = tmp_path / "jobs"
    jobs.mkdir()
    monkeypatch.setenv("FAKE_SLURM", str(jobs))
    monkeypatch.setenv("PATH", f"{FAKE}{os.pathsep}{os.environ['PATH']}")
    monkeypatch.setenv("PYTHONPATH", str(ROOT))
    yield jobs
    for file in jobs.glob("*.pid"):
        os.killpg(int(file.read_text()), signal.SIGKILL)


@pytest.mark.slow
@linux
def test_the_scripts_start_a_cluster_that_runs_cases_over_tls(tmp_path: Path, slurm: Path) -> None:
    folder = written(tmp_path / "cluster")
    started = subprocess.run(["sh", str(folder / "start.sh")], capture_output=True, text=True, check=True)
    assert started.stdout == "scheduler: job 1, workers: job 2\n"
    assert "--dependency=after:1" in (slurm / "job-2").read_text()
    until((folder / "scheduler.json").exists)
    assert json.loads((folder / "scheduler.json").read_text())["address"].startswith("tls://")
    cases = [Case(f"{i}-ok", {"name": "ok"}, {}) for i in range(6)]
    address = ClusterAddress(f"file:{folder}/scheduler.json")
    runner = "tests.service.cluster.runners:insertion"
    with ClusterCrew(address, folder=tmp_path / "out", files=tmp_path, runner=runner) as crew:
        outcomes = list(crew.run_many(cases))
        assert {outcome.result["status"] for outcome in outcomes} == {"completed"}
        assert len(outcomes) == 6
    plain = subprocess.run(
        [sys.executable, "-c", f"from distributed import Client; Client('{_plain(folder)}', timeout=3)"],
        capture_output=True,
        text=True,
        check=False,
    )
    assert plain.returncode != 0  # without the key there is no answer


def _plain(folder: Path) -> str:
    return str(json.loads((folder / "scheduler.json").read_text())["address"]).replace("tls://", "tcp://")
