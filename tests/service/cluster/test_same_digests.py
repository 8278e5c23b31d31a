"""A campaign on a cluster gives the digests of the plain command line, and its folder is bundled like any other."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING

import pytest
from click.testing import CliRunner
from pyarrow import parquet

from service.cli.main import main
from tests.service.cluster.local_cluster import local_cluster

if TYPE_CHECKING:
    from pathlib import Path

WORKER = ("-m", "service.cli", "cluster", "worker")
PATH = '{"kind":"line","target_mm":[18,31,12],"speed_mm_s":20}'
CAMPAIGN = (
    *("--controller", "ifem", "--controller", "open_loop", "--grid", f"trajectory=[{PATH}]"),
    *("--grid", "tissue.element_size_mm=15", "--grid", "dt_s=0.05", "--name", "tiny"),
)


def run(out: Path, *more: str) -> dict[str, str]:
    """The digests of its cases."""
    result = CliRunner().invoke(main, ["campaign", "run", *CAMPAIGN, "--out", str(out), *more])
    assert result.exit_code == 0, result.output
    table = parquet.read_table(out / "campaign.parquet").to_pylist()
    assert all(row["status"] == "completed" and row["cpu"] for row in table)
    assert all((out / "series" / row["series_sha256"][:2] / f"{row['series_sha256']}.npz").is_file() for row in table)
    return {row["case"]: row["digest"] for row in table}


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="one worker is ended by a signal")
def test_digests_are_those_of_the_plain_command_line(tmp_path: Path) -> None:
    here = run(tmp_path / "here", "--workers", "1")
    with local_cluster(tmp_path / "cluster", 1, worker=WORKER) as cluster:
        there = run(tmp_path / "there", "--cluster", f"file:{cluster.file}")
        cluster.workers[0].terminate()
        assert cluster.workers[0].wait(timeout=60) == 0
    assert len(here) == 2
    assert there == here
    bundle = ["bundle", "make", str(tmp_path / "there"), "--out", str(tmp_path / "tiny.zip"), "--sample", "0"]
    result = CliRunner().invoke(main, bundle)
    assert result.exit_code == 0, result.output
    result = CliRunner().invoke(main, ["bundle", "check", str(tmp_path / "tiny.zip")])
    assert "2 cases" in result.output
