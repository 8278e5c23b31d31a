"""The Sphinx extension: fills the pages in before they are parsed, and reads such pages at every build.

`<!-- generated: NAME -->` becomes a generated part; `<!-- page of the project: NAME.md -->` the text of a file at the
root of the project, its links followed from there.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING, Any

from page_tables import part

if TYPE_CHECKING:
    from sphinx.application import Sphinx

ROOT = Path(__file__).parents[2]
GENERATED = re.compile(r"^<!-- generated: (.+?) -->$", re.MULTILINE)
OF_PROJECT = re.compile(r"^<!-- page of the project: (\w+\.md) -->$", re.MULTILINE)
LINK = re.compile(r"\]\((?!https?:|#)([^)#]+)")
PAGES = {  # files outside docs/ that are pages of the site
    "README.md": "index.md",
    "ARCHITECTURE.md": "architecture.md",
    "CONTRIBUTING.md": "contributing.md",
    "CHANGELOG.md": "changelog.md",
    "SECURITY.md": "security.md",
    "simcore/README.md": "equations.md",
    "benchmarks/results/verification.md": "verification.md",
}


def filled(text: str) -> str:
    """A page with what it asks for."""
    text = OF_PROJECT.sub(lambda mark: from_root((ROOT / mark[1]).read_text(encoding="utf-8")), text)
    return GENERATED.sub(lambda mark: part(mark[1]), text)


def from_root(text: str) -> str:
    """The text of a file at the root of the project, with links as they are from docs/."""
    return LINK.sub(lambda link: f"]({_from_docs(link[1])}", text)


def _from_docs(target: str) -> str:
    return PAGES.get(target) or (target.removeprefix("docs/") if target.startswith("docs/") else f"../{target}")


def setup(app: Sphinx) -> dict[str, Any]:
    """Called by Sphinx."""
    app.connect("source-read", _fill)
    app.connect("env-get-outdated", _pages_with_parts)
    return {"parallel_read_safe": True, "parallel_write_safe": True}


def _fill(_app: Sphinx, _name: str, source: list[str]) -> None:
    source[0] = filled(source[0])


def _pages_with_parts(_app: Sphinx, env: Any, *_: Any) -> list[str]:
    texts = {name: Path(env.doc2path(name)).read_text(encoding="utf-8") for name in env.found_docs}
    return [name for name, text in texts.items() if GENERATED.search(text) or OF_PROJECT.search(text)]
