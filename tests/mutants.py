"""A sample of mutants: small faults put into the code one at a time, each to be noticed by the nearest tests.

    python -m tests.mutants --each 4 --seed 1 --out out/mutants.md

Works in a clone of the last commit, so that nothing in the checkout changes, whatever interrupts it. A mutant that no
test notices has survived: it is printed with its difference, and a test that catches it is owed, or a reason.
"""

from __future__ import annotations

import argparse
import os
import random
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

from cosmic_ray.commands import init
from cosmic_ray.mutating import mutate_and_test
from cosmic_ray.work_db import WorkDB
from cosmic_ray.work_item import TestOutcome, WorkItem

ROOT = Path(__file__).resolve().parents[1]
TIMEOUT_S = 600.0
NOT_MUTATED = ("core/ReplaceBinaryOperator_BitOr_", "core/RemoveDecorator")  # types in annotations, kernels
NEAREST = {  # module -> tests that stand beside it
    "simcore/metrics.py": "tests/simcore/test_metrics.py",
    "simcore/trajectory.py": "tests/simcore/test_trajectory.py",
    "simcore/robot.py": "tests/simcore/test_robot.py",
    "simcore/controllers/ifem.py": "tests/simcore/controllers",
    "simcore/controllers/remote_centre.py": "tests/simcore/controllers",
    "simcore/learning/elm.py": "tests/simcore/learning/test_learning.py",
    "simcore/scenario/rules.py": "tests/simcore/scenario",
    "simcore/mesh/quality.py": "tests/simcore/mesh",
    "simcore/rollout/series.py": "tests/simcore/rollout",
    "benchmarks/trend.py": "tests/benchmarks/test_trend.py",
    "benchmarks/paper/statistics.py": "tests/benchmarks/paper/test_statistics.py",
    "benchmarks/paper/comparison.py": "tests/benchmarks/paper",
    "service/store/jobs.py": "tests/service/store",
    "service/store/transitions.py": "tests/service/store",
    "service/store/schedule.py": "tests/service/api/test_schedules.py",
    "service/engine/retention.py": "tests/service/engine",
    "service/engine/attempt_watch.py": "tests/service/engine/test_attempt_watch.py",
    "service/admission/cost.py": "tests/service/admission",
    "service/api/middleware/rate_limit.py": "tests/service/store/test_keys.py tests/service/api",
    "service/recording/plots.py": "tests/service/recording",
}


@dataclass(frozen=True)
class Tried:
    """One mutant and what became of it."""

    module: str
    survived: bool
    difference: str


def mutants_of(module: Path) -> list[WorkItem]:
    """Every mutant of a module, in the order of its text."""
    with tempfile.TemporaryDirectory() as folder:
        database = WorkDB(str(Path(folder) / "mutants.sqlite"), WorkDB.Mode.create)
        try:
            init([module], database, {})
            items = list(database.work_items)
        finally:
            database.close()
    usable = [item for item in items if not item.mutations[0].operator_name.startswith(NOT_MUTATED)]
    return sorted(usable, key=lambda item: (*item.mutations[0].start_pos, item.mutations[0].operator_name))


def sample(items: list[WorkItem], count: int, draw: random.Random) -> list[WorkItem]:
    """At most `count` mutants, each on its own line: operators with many replacements do not crowd out others."""
    lines: dict[int, list[WorkItem]] = {}
    for item in items:
        lines.setdefault(item.mutations[0].start_pos[0], []).append(item)
    chosen = draw.sample(sorted(lines), min(count, len(lines)))
    return [draw.choice(lines[line]) for line in chosen]


def try_mutant(item: WorkItem, module: str, tests: str) -> Tried:
    """Put the mutant in, run the nearest tests, take it out again."""
    command = f"{sys.executable} -m pytest -q -x -p no:cacheprovider -p no:randomly {tests}"
    result = mutate_and_test(item.mutations, command, TIMEOUT_S)
    return Tried(module, result.test_outcome is TestOutcome.SURVIVED, result.diff or "")


def run(each: int, seed: int, modules: dict[str, str]) -> list[Tried]:
    """Try `each` mutants of every module; to be called in the folder whose files may change."""
    draw, tried = random.Random(seed), []
    for module, tests in modules.items():
        for item in sample(mutants_of(Path(module)), each, draw):
            tried.append(try_mutant(item, module, tests))
            print(f"{'SURVIVED' if tried[-1].survived else 'noticed '}  {module}", flush=True)
    return tried


def page(tried: list[Tried], seed: int) -> str:
    """The outcome as Markdown: a row for each module, then the difference of every survivor."""
    lines = [f"# Mutants, seed {seed}", "", "| module | tried | noticed |", "| --- | --- | --- |"]
    for module in dict.fromkeys(one.module for one in tried):
        own = [one for one in tried if one.module == module]
        lines.append(f"| {module} | {len(own)} | {sum(not one.survived for one in own)} |")
    survivors = [one for one in tried if one.survived]
    lines += ["", f"All: {len(tried) - len(survivors)} of {len(tried)} noticed.", ""]
    for one in survivors:
        lines += [f"## Survivor in {one.module}", "", "```diff", one.difference.strip(), "```", ""]
    return "\n".join(lines)


def main() -> int:
    """The command; exit code 1 if a mutant survived."""
    parser = argparse.ArgumentParser(prog="python -m tests.mutants", description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--each", type=int, default=3, metavar="N", help="mutants of each module (default 3)")
    parser.add_argument("--seed", type=int, default=1, help="which mutants are drawn (default 1)")
    parser.add_argument("--module", action="append", choices=NEAREST, help="only this module; may be repeated")
    parser.add_argument("--out", type=Path, default=Path("out/mutants.md"), help="the page to write")
    arguments = parser.parse_args()
    modules = {name: NEAREST[name] for name in arguments.module or NEAREST}
    with tempfile.TemporaryDirectory() as folder:
        clone = Path(folder) / "needlebench"
        subprocess.run(["git", "clone", "--quiet", str(ROOT), str(clone)], check=True)
        os.chdir(clone)
        os.environ["PYTHONPATH"] = str(clone)
        tried = run(arguments.each, arguments.seed, modules)
        os.chdir(ROOT)
    out = ROOT / arguments.out
    out.parent.mkdir(parents=True, exist_ok=True)
    out.write_text(page(tried, arguments.seed), encoding="utf-8")
    print(f"{sum(not one.survived for one in tried)} of {len(tried)} noticed; {out}")
    return int(any(one.survived for one in tried))


if __name__ == "__main__":
    sys.exit(main())
