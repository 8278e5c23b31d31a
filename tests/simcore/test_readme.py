"""simcore/README.md names what is there: every code name in its tables is a module or a definition of simcore. The
examples in docstrings give what they show."""

from __future__ import annotations

import ast
import doctest
import importlib
import re
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2] / "simcore"


def code_names() -> list[str]:
    """The names between backticks in the second column of every table."""
    rows = [line.split(" | ") for line in (ROOT / "README.md").read_text().splitlines() if line.startswith("| ")]
    return sorted({name for row in rows for name in re.findall(r"`([^`]+)`", row[1])})


@cache
def definitions(module: Path) -> set[str]:
    """Functions and classes of a module, methods as `Class.method`."""
    found = set()
    for node in ast.parse(module.read_text()).body:
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            found.add(node.name)
        if isinstance(node, ast.ClassDef):
            found |= {f"{node.name}.{part.name}" for part in node.body if isinstance(part, ast.FunctionDef)}
    return found


def is_defined(name: str) -> bool:
    """`tissue.model.elastic_forces`, `insertion.insertion.Insertion.step`, or a module: `learning.elm`."""
    parts = name.split(".")
    for length in range(1, len(parts) + 1):
        module = ROOT.joinpath(*parts[:length]).with_suffix(".py")
        if module.is_file():
            return length == len(parts) or ".".join(parts[length:]) in definitions(module)
    return False


def test_the_tables_name_code() -> None:
    assert len(code_names()) > 40


@pytest.mark.parametrize("name", code_names())
def test_every_code_name_is_a_definition(name: str) -> None:
    assert is_defined(name)


def test_a_name_that_is_gone_would_be_seen() -> None:
    assert not is_defined("tissue.model.nothing")
    assert not is_defined("nowhere.model")


@pytest.mark.slow
@pytest.mark.parametrize("module", ["simcore.scenario.scenario", "simcore.rollout.rollout", "simcore.episode.episode"])
def test_the_examples_of_the_docstrings(module: str) -> None:
    done = doctest.testmod(importlib.import_module(module))
    assert done.attempted > 1
    assert done.failed == 0
