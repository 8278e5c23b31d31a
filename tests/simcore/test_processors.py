"""Nothing that a digest depends on goes through code that is chosen by the processor."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2] / "simcore"
CHOSEN = {  # of NumPy and of the system's mathematical library: one of several versions
    *("dot", "vdot", "inner", "matmul", "tensordot", "polyfit", "leggauss"),
    *("sin", "cos", "tan", "arcsin", "arccos", "arctan", "arctan2", "asin", "acos", "atan", "atan2", "sinh", "cosh"),
    *("tanh", "exp", "expm1", "log", "log1p", "log2", "log10", "pow", "power", "expit"),
}
MODULES = {"np", "numpy", "math", "scipy"}


def choices(source: str) -> list[str]:
    """What of it is chosen by the processor: products by BLAS, LAPACK, elementary functions."""
    found = []
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.BinOp | ast.AugAssign) and isinstance(node.op, ast.MatMult):
            found.append(f"{node.lineno}: @")
        elif isinstance(node, ast.ImportFrom) and (node.module or "").startswith(("scipy.linalg", "scipy.special")):
            found.append(f"{node.lineno}: {node.module}")
        elif isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute):
            name = ast.unparse(node.func)
            norms = name == "np.linalg.norm" and any(word.arg == "axis" for word in node.keywords)
            lapack = name.startswith("np.linalg.") and "(" not in name and not norms
            if lapack or (node.func.attr in CHOSEN and name.split(".")[0] in MODULES):
                found.append(f"{node.lineno}: {name}")
    return found


SPARSE = "insertion/jacobian_exact.py"  # scipy.sparse multiplies a row at a time, in one order


@pytest.mark.parametrize("path", sorted(ROOT.rglob("*.py")), ids=lambda path: str(path.relative_to(ROOT)))
def test_no_file_of_the_simulation_uses_what_is_chosen_by_the_processor(path: Path) -> None:
    found = choices(path.read_text(encoding="utf-8"))
    allowed = 3 if str(path.relative_to(ROOT)) == SPARSE else 0
    assert len(found) <= allowed, found


LINES = ("a @ b", "a @= b", "np.dot(a, b)", "np.linalg.norm(a)", "np.linalg.solve(a, b)", "math.sin(x)", "np.exp(x)")


@pytest.mark.parametrize("line", LINES)
def test_such_a_line_is_seen(line: str) -> None:
    assert len(choices(line)) == 1
