"""A sample of mutants: small faults put into the code one at a time, each to be noticed by the nearest tests.

    python -m tests.mutants --each 4 --seed 1 --out out/mutants.md

Works in a clone of the last commit, so that nothing in the checkout changes, whatever interrupts it. A mutant that no
test notices has survived: it is printed with its difference, and a test that catches it is owed, or a reason.
"""

from __future__ import annotations

import argparse
import ast
import os
import random
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from difflib import unified_diff
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterator

ROOT = Path(__file__).resolve().parents[1]
TIMEOUT_S = 600.0
SWAPPED = {  # operator -> what stands in its place
    "<": "<=", "<=": "<", ">": ">=", ">=": ">", "==": "!=", "!=": "==", "in": "not in", "not in": "in",
    "is": "is not", "is not": "is", "+": "-", "-": "+", "*": "/", "/": "*", "//": "/", "%": "*", "**": "*",
    "and": "or", "or": "and",
}  # fmt: skip
NEAREST = {  # module -> tests that stand beside it
    "simcore/metrics.py": "tests/simcore/test_metrics.py",
    "simcore/trajectory/path.py": "tests/simcore/test_trajectory.py tests/simcore/test_curves.py",
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
    "service/admission/pace.py": "tests/service/admission/test_pace.py",
    "service/api/middleware/rate_limit.py": "tests/service/store/test_keys.py tests/service/api",
    "service/recording/plots.py": "tests/service/recording",
}


@dataclass(frozen=True)
class Mutant:
    """One small fault: the text between two offsets (bytes) of a module is replaced."""

    line: int
    start: int
    end: int
    text: str

    def of(self, source: bytes) -> bytes:
        """The module with the fault in it."""
        return source[: self.start] + self.text.encode() + source[self.end :]


@dataclass(frozen=True)
class Tried:
    """One mutant and what became of it."""

    module: str
    survived: bool
    difference: str


class Mutator:
    """Finds the mutants of a module: numbers one higher, operators swapped, negations dropped; types stay."""

    def __init__(self, source: bytes) -> None:
        self._source, self._starts = source, [0]
        for line in source.splitlines(keepends=True):
            self._starts.append(self._starts[-1] + len(line))

    def mutants(self) -> list[Mutant]:
        """All of them, in the order of the tree."""
        return list(self._visit(ast.parse(self._source)))

    def _span(self, node: ast.expr) -> tuple[int, int]:
        assert node.end_lineno is not None
        assert node.end_col_offset is not None
        return self._starts[node.lineno - 1] + node.col_offset, self._starts[node.end_lineno - 1] + node.end_col_offset

    def _visit(self, node: ast.AST) -> Iterator[Mutant]:
        for name, value in ast.iter_fields(node):
            if name not in ("annotation", "returns", "decorator_list", "type_params"):
                for child in value if isinstance(value, list) else [value]:
                    if isinstance(child, ast.AST):
                        yield from self._visit(child)
        yield from self._of(node)

    def _of(self, node: ast.AST) -> Iterator[Mutant]:
        match node:
            case ast.Compare(left=left, comparators=[right]):
                yield from self._swapped(left, right)
            case ast.BinOp(left=left, right=right):
                yield from self._swapped(left, right)
            case ast.BoolOp(values=[left, right, *_]):
                yield from self._swapped(left, right)
            case ast.UnaryOp(op=ast.Not(), operand=operand):
                yield Mutant(node.lineno, *self._span(node), self._source[slice(*self._span(operand))].decode())
            case ast.Constant(value=int() | float() as value) if not isinstance(value, bool):
                yield Mutant(node.lineno, *self._span(node), f"({value!r} + 1)")

    def _swapped(self, left: ast.expr, right: ast.expr) -> Iterator[Mutant]:
        start, end = self._span(left)[1], self._span(right)[0]
        text = self._source[start:end].decode()
        operator = text.strip(" ()\n")
        if operator in SWAPPED:
            yield Mutant(left.lineno, start, end, text.replace(operator, SWAPPED[operator]))


def sample(mutants: list[Mutant], count: int, draw: random.Random) -> list[Mutant]:
    """At most `count` mutants, each on its own line: long formulas do not crowd out the rest."""
    lines: dict[int, list[Mutant]] = {}
    for mutant in mutants:
        lines.setdefault(mutant.line, []).append(mutant)
    chosen = draw.sample(sorted(lines), min(count, len(lines)))
    return [draw.choice(lines[line]) for line in chosen]


def try_mutant(mutant: Mutant, module: str, tests: str) -> Tried:
    """Put the mutant in, run the nearest tests, take it out again."""
    path = Path(module)
    source = path.read_bytes()
    faulty = mutant.of(source)
    path.write_bytes(faulty)
    try:
        command = [sys.executable, "-m", "pytest", "-q", "-x", "-p", "no:cacheprovider", *tests.split()]
        done = subprocess.run(command, capture_output=True, timeout=TIMEOUT_S, check=False)
        survived = done.returncode == 0
    except subprocess.TimeoutExpired:
        survived = False
    finally:
        path.write_bytes(source)
    before, after = source.decode().splitlines(), faulty.decode().splitlines()
    return Tried(module, survived, "\n".join(unified_diff(before, after, module, module, n=2, lineterm="")))


def run(each: int, seed: int, modules: dict[str, str]) -> list[Tried]:
    """Try `each` mutants of every module; to be called in the folder whose files may change."""
    draw, tried = random.Random(seed), []
    for module, tests in modules.items():
        for mutant in sample(Mutator(Path(module).read_bytes()).mutants(), each, draw):
            tried.append(try_mutant(mutant, module, tests))
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
