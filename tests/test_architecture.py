"""Packages, sizes and words of the code. The direction of imports is checked by import-linter (pyproject.toml)."""

from __future__ import annotations

import ast
import re
import sys
from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from collections.abc import Iterator

ROOT = Path(__file__).resolve().parent.parent
PACKAGES = ("simcore", "benchmarks", "service", "needlebench")
SHIPPED = sorted(p for name in PACKAGES for p in (ROOT / name).rglob("*.py"))
ALONE = [ROOT / name for name in ("bootstrap.py", "bootstrap_python.py", "hatch_build.py")]
TESTS = sorted((ROOT / "tests").rglob("*.py"))

MAXIMUM_FILE_LINES = 300
MAXIMUM_FUNCTION_LINES = 50  # without its signature
LONGER = {
    "bootstrap.py": "one file, so that any Python can run it",
    "rotate_and_stress": "unrolled by hand, so that the compiler makes SIMD code of it",
    "paper": "mostly its help",
}
MAXIMUM_MODULES = 25  # of a folder

SIMCORE_NEEDS = {"numpy", "scipy", "numba", "pydantic", "pydantic_core", "threadpoolctl", "platformdirs"}
SIMCORE_NEEDS |= {"llvmlite"}  # a part of numba
BENCHMARKS_NEED = {*SIMCORE_NEEDS, "simcore", "benchmarks", "jinja2", "rfc8785"}  # pages; manifests of bundles
NETWORK = {"http", "socket", "socketserver", "urllib", "ssl", "asyncio", "sqlite3", "ftplib", "smtplib"}


def module_of(path: Path) -> str:
    """simcore/controllers/ifem.py -> simcore.controllers.ifem."""
    return ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")


def tree_of(path: Path) -> ast.Module:
    return ast.parse(path.read_text(encoding="utf-8"), str(path))


def imports(path: Path) -> Iterator[tuple[str, int]]:
    """Every imported module with its line, those inside functions too; not those for the type checker alone."""

    def visit(node: ast.AST) -> Iterator[tuple[str, int]]:
        if isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test):
            for other in node.orelse:
                yield from visit(other)
        elif isinstance(node, ast.Import):
            yield from ((alias.name, node.lineno) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            yield from from_imports(node, path)
        else:
            for child in ast.iter_child_nodes(node):
                yield from visit(child)

    return visit(tree_of(path))


def from_imports(node: ast.ImportFrom, path: Path) -> Iterator[tuple[str, int]]:
    """`from simcore.tissue import model` names a module, `from simcore.tissue.model import TissueModel` one, too."""
    base = node.module or ""
    if node.level:
        parents = path.relative_to(ROOT).parts[: -node.level]
        base = ".".join([*parents, *([base] if base else [])])
    folder = ROOT.joinpath(*base.split("."))
    for alias in node.names:
        inner = (folder / f"{alias.name}.py").exists() or (folder / alias.name / "__init__.py").exists()
        yield (f"{base}.{alias.name}" if inner else base), node.lineno


def offences(paths: list[Path], allowed: object) -> list[str]:
    """`file:line imports module` for every import that `allowed(path, module)` refuses."""
    assert callable(allowed)
    return [
        f"{path.relative_to(ROOT)}:{line} imports {name}"
        for path in paths
        for name, line in imports(path)
        if not allowed(path, name)
    ]


def of(package: str) -> list[Path]:
    return [path for path in SHIPPED if path.is_relative_to(ROOT / package)]


def top(name: str) -> str:
    return name.split(".", maxsplit=1)[0]


# ---- what may import what


@pytest.mark.slow
def test_simcore_needs_numbers_only() -> None:
    """No service, no Rerun, no HTTP, no database: the physics runs wherever its arrays do. Only the room of remote
    controllers has a socket, and a rollout as a DataFrame is one of pandas."""
    known = SIMCORE_NEEDS | {"simcore"} | (sys.stdlib_module_names - NETWORK)

    def allowed(path: Path, name: str) -> bool:
        only_here = {"socket": "remote", "pandas": "rollout"}  # pandas is asked for when somebody asks for a DataFrame
        return top(name) in known or only_here.get(name) == path.parent.name

    assert not offences(of("simcore"), allowed)


@pytest.mark.slow
def test_benchmarks_need_simcore_only() -> None:
    """Gymnasium where the environments are measured, if it is there."""
    known = BENCHMARKS_NEED | {"needlebench"} | (sys.stdlib_module_names - NETWORK)

    def allowed(path: Path, name: str) -> bool:
        return top(name) in known or (top(name) == "gymnasium" and path.stem == "environments")

    assert not offences(of("benchmarks"), allowed)


# ---- sizes and words


def test_no_file_is_too_long() -> None:
    lengths = {str(p.relative_to(ROOT)): len(p.read_text("utf-8").splitlines()) for p in [*SHIPPED, *ALONE]}
    assert not {n: lines for n, lines in lengths.items() if lines > MAXIMUM_FILE_LINES and n not in LONGER}


def test_no_folder_is_a_hall() -> None:
    folders = Counter(str(path.parent.relative_to(ROOT)) for path in SHIPPED)
    assert not {folder: modules for folder, modules in folders.items() if modules > MAXIMUM_MODULES}


@pytest.mark.slow
def test_no_function_is_too_long() -> None:
    found = {}
    for path in [*SHIPPED, *ALONE]:
        for node in ast.walk(tree_of(path)):
            if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef) and node.name not in LONGER:
                assert node.end_lineno is not None
                name = f"{path.relative_to(ROOT)}:{node.lineno} {node.name}"
                found[name] = node.end_lineno - node.body[0].lineno + 1  # a wrapped signature is no length
    assert not {name: lines for name, lines in found.items() if lines > MAXIMUM_FUNCTION_LINES}


@pytest.mark.slow
def test_every_module_says_what_it_is() -> None:
    full = [path for path in [*SHIPPED, *ALONE] if path.read_text("utf-8").strip()]
    assert not [str(path.relative_to(ROOT)) for path in full if not ast.get_docstring(tree_of(path))]


def lines_matching(pattern: str, paths: list[Path]) -> list[str]:
    return [
        f"{path.relative_to(ROOT)}:{number} {line.strip()[:80]}"
        for path in paths
        for number, line in enumerate(path.read_text("utf-8").splitlines(), start=1)
        if re.search(pattern, line)
    ]


@pytest.mark.slow
def test_no_loose_ends() -> None:
    words = ("TO" + "DO", "FIX" + "ME", "XX" + "X", "HA" + "CK")
    assert not lines_matching(rf"\b({'|'.join(words)})\b", [*SHIPPED, *ALONE, *TESTS])


@pytest.mark.slow
def test_no_paths_of_one_machine() -> None:
    folders = ("work", "home", "Users", "root", "mnt")
    texts = [p for pattern in ("*.md", "*.toml", "*.cff", "Makefile") for p in ROOT.glob(pattern)]
    assert not lines_matching(rf"(?<![\w.\-}}])/({'|'.join(folders)})/\w", [*SHIPPED, *ALONE, *TESTS, *texts])


def test_no_module_of_utilities() -> None:
    assert not [str(path) for path in SHIPPED if path.stem in ("utils", "util", "helpers", "common", "misc")]
