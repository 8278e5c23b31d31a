"""A campaign on four workers of a cluster that are killed, its bundle, and the bundle's verification elsewhere.

    python -m tests.chaos.cluster_campaign DIR --insertions 2000 --kills 40

goes on where it was interrupted. The second checkout is a clone of this one's commit, with an empty home: it compiles
its kernels anew.
"""

from __future__ import annotations

import argparse
import json
import os
import random
import subprocess
import sys
import threading
import time
from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pyarrow import parquet

from tests.acceptance.server import ROOT
from tests.service.cluster.local_cluster import LocalCluster, local_cluster

if TYPE_CHECKING:
    from collections.abc import Sequence

WORKERS = 4
WORKER = ("-m", "service.cli", "cluster", "worker")
SCENARIO: dict[str, Any] = {
    "name": "tiny",
    "dt_s": 0.1,
    "noise_mm": 0.25,
    "tissue": {"size_mm": [24, 40, 40], "element_size_mm": 10},
    "needle": {"length_mm": 80, "elements": 8},
    "interaction": {"spacing_mm": 10},
    "trajectory": {"kind": "sine", "entry_mm": [12, 20, 0], "target_mm": [12, 22, 40], "amplitude_mm": 1.0},
    "recording": {"enabled": False},
}


def campaign_words(folder: Path, insertions: int) -> list[str | Path]:
    """The command without where it runs: two controllers, each with half of the seeds."""
    scenario, seeds = folder / "tiny.json", folder / "seeds.json"
    scenario.write_text(json.dumps(SCENARIO))
    seeds.write_text(json.dumps(list(range(1, insertions // 2 + 1))))
    controllers = ("--controller", "ifem", "--controller", "open_loop")
    words = ["campaign", "run", "--scenario", str(scenario), *controllers, "--grid", f"seed=@{seeds}"]
    return [*words, "--name", "tiny under kills"]


def under_kills(folder: Path, insertions: int, kills: int, chance: random.Random) -> dict[str, Any]:
    """Run the campaign into folder/campaign; what was killed and what came of it."""
    folder.mkdir(parents=True, exist_ok=True)
    out = folder / "campaign"
    killed: Counter[str] = Counter()
    over = threading.Event()
    with local_cluster(folder / f"cluster-{time.time_ns()}", WORKERS, worker=WORKER) as cluster:
        words = campaign_words(folder, insertions)
        command = [sys.executable, "-m", "service.cli", *words, "--out", out, "--cluster", f"file:{cluster.file}"]
        campaign = subprocess.Popen(command, cwd=ROOT)
        thread = threading.Thread(target=_kill, args=(cluster, out, insertions, kills, chance, killed, over))
        thread.start()
        code = campaign.wait()
        over.set()
        thread.join()
    assert code == 0, code
    return {**killed, **summary(out / "campaign.parquet", insertions)}


def _kill(
    cluster: LocalCluster,
    out: Path,
    insertions: int,
    kills: int,
    chance: random.Random,
    killed: Counter[str],
    over: threading.Event,
) -> None:
    """Workers, spread over the campaign, and once in its middle the scheduler."""
    begun = _finished(out)
    for number in range(kills):
        due = begun + (insertions - begun) * (number + 1) // (kills + 2)
        while not over.is_set() and _finished(out) < due:
            time.sleep(0.2)
        if over.wait(chance.uniform(0.0, 0.5)):
            return
        if number == kills // 2:
            cluster.kill_scheduler()
            cluster.start_scheduler()
            killed["schedulers_killed"] += 1
        chance.choice([one for one in cluster.workers if one.poll() is None]).kill()
        cluster.start_worker()
        killed["workers_killed"] += 1


def _finished(out: Path) -> int:
    file = out / "outcomes.jsonl"
    return file.read_bytes().count(b"\n") if file.exists() else 0


def summary(table: Path, insertions: int) -> dict[str, Any]:
    """What the Parquet table says; every insertion is in it, once."""
    rows = parquet.read_table(table).to_pylist()
    assert len(rows) == len({row["case"] for row in rows}) == insertions
    assert all(row["digest"] and row["cpu"] for row in rows), Counter(row["status"] for row in rows)
    attempts = Counter(row["cost_attempts"] for row in rows)
    return {
        "insertions": insertions,
        "run_again": insertions - attempts[1],
        "most_attempts": max(attempts),
        "cpu_s_each": round(sum(row["cost_cpu_s"] for row in rows) / insertions, 3),
        "table_kb": round(table.stat().st_size / 1e3),
    }


def same_as_here(folder: Path, insertions: int, few: int) -> int:
    """How many of the first cases give the same digest by the plain command line on this machine."""
    from benchmarks.grid.suite import grid
    from simcore.rollout.rollout import run
    from simcore.scenario.scenario import Scenario

    axes: dict[str, list[Any]] = {
        "controller": [{"kind": "ifem"}, {"kind": "open_loop"}],
        "seed": list(range(1, insertions // 2 + 1)),
    }
    digests = {
        row["case"]: row["digest"] for row in parquet.read_table(folder / "campaign" / "campaign.parquet").to_pylist()
    }
    cases = grid(SCENARIO, axes, name="tiny under kills").cases[:few]
    return sum(run(Scenario.load(case.scenario)).digest == digests[case.id] for case in cases)


def verified_elsewhere(folder: Path, sample: int) -> str:
    """Make the bundle, verify it in a clone with an empty home, make its leaderboard; what the verification says."""
    bundle, clone, home = folder / "tiny.zip", folder / "clone", folder / "home"
    home.mkdir(exist_ok=True)
    if not clone.exists():
        subprocess.run(["git", "clone", "-q", str(ROOT), str(clone)], check=True)
    here = [sys.executable, "-m", "service.cli", "bundle"]
    made = [*here, "make", str(folder / "campaign"), "--out", str(bundle), "--sample", "3", "--force"]
    subprocess.run(made, cwd=ROOT, check=True)
    elsewhere = {"PATH": os.environ["PATH"], "HOME": str(home), "PYTHONPATH": str(clone)}
    verify = [*here, "verify", str(bundle), "--sample", str(sample), "--seed", "1", "--by", "a second checkout"]
    done = subprocess.run(verify, cwd=clone, env=elsewhere, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    site = [sys.executable, "-m", "service.cli", "leaderboard", str(bundle), "--out", str(folder / "site"), "--force"]
    subprocess.run(site, cwd=ROOT, check=True)
    return done.stdout


def main(arguments: Sequence[str]) -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--insertions", type=int, default=2000)
    parser.add_argument("--kills", type=int, default=40)
    parser.add_argument("--seed", type=int, default=1)
    given = parser.parse_args(arguments)
    folder = given.folder.absolute()
    print(json.dumps(under_kills(folder, given.insertions, given.kills, random.Random(given.seed))), flush=True)
    print(f"{same_as_here(folder, given.insertions, 10)} of 10 digests are those of this machine", flush=True)
    print(verified_elsewhere(folder, 10), flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
