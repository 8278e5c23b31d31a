"""The site builds without a warning, and every link inside the project leads somewhere."""

from __future__ import annotations

import re
import subprocess
import sys
from typing import TYPE_CHECKING

import pytest

from tests.docs.snippets import pages
from tests.docs.sources import DOCS, ROOT

if TYPE_CHECKING:
    from pathlib import Path

LINK = re.compile(r"\]\(((?!https?:|mailto:)[^)\s#]+)(#[\w-]+)?\)")
NAMED_FILES = re.compile(r"`((?:simcore|benchmarks|service|tests)/[\w/]+(?:\.\w+)?)`")


@pytest.mark.slow
def test_the_site_builds_without_a_warning(tmp_path: Path) -> None:
    """As `make docs` does it; every page is there, with its generated parts in place of the marks."""
    pytest.importorskip("sphinx")
    command = [sys.executable, "-m", "sphinx", "-q", "-W", "--keep-going", "-b", "html", str(DOCS), str(tmp_path)]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=600)
    assert done.returncode == 0, done.stderr
    for page in DOCS.glob("*.md"):
        built = (tmp_path / f"{page.stem}.html").read_text(encoding="utf-8")
        assert "<!-- generated:" not in built, page.name
        assert "<!-- page of" not in built, page.name
    assert "tissue.young_kpa" in (tmp_path / "parameters.html").read_text()
    assert "Unreleased" in (tmp_path / "changelog.html").read_text()
    assert "fonts.googleapis" not in (tmp_path / "index.html").read_text()


@pytest.mark.parametrize("page", pages(), ids=lambda page: page.name)
def test_links_lead_to_files(page: Path) -> None:
    for target, _ in LINK.findall(page.read_text(encoding="utf-8")):
        assert (page.parent / target).exists(), f"{page.name}: {target}"


@pytest.mark.parametrize("page", pages(), ids=lambda page: page.name)
def test_files_of_the_code_that_a_page_names_exist(page: Path) -> None:
    for name in NAMED_FILES.findall(page.read_text(encoding="utf-8")):
        assert (ROOT / name).exists(), f"{page.name}: {name}"


def test_every_page_is_in_the_navigation() -> None:
    listed = set()
    for page in DOCS.glob("*.md"):
        for block in re.findall(r"```\{toctree\}\n(.*?)```", page.read_text(), re.DOTALL):
            lines = [line.strip() for line in block.splitlines() if line.strip() and not line.startswith(":")]
            listed |= {re.sub(r".*<(\w+)>$", r"\1", line) for line in lines}
    assert {page.stem for page in DOCS.glob("*.md")} == listed | {"index"}


def test_the_build_fetches_nothing() -> None:
    configuration = (DOCS / "conf.py").read_text()
    assert "intersphinx" not in configuration
    assert "http" not in configuration
