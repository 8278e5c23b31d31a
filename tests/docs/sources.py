"""Where the pages are, and the programs beside them, which are no package."""

from __future__ import annotations

import importlib.util
import sys
from functools import cache
from pathlib import Path
from types import ModuleType

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"


@cache
def program(path: str) -> ModuleType:
    """The module in docs/PATH.py, imported under a name that nothing else has."""
    name = "docs_" + path.replace("/", "_")
    spec = importlib.util.spec_from_file_location(name, DOCS / f"{path}.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    spec.loader.exec_module(module)
    return module
