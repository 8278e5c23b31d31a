"""The README is short, says what the code does, and shows no stale table."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from simcore.scenario.parameters import parameters
from tests.docs.sources import program

ROOT = Path(__file__).parent.parent
README = (ROOT / "README.md").read_text(encoding="utf-8")
LONGEST_BYTES = 8192


def section(name: str) -> str:
    """The text between the markers of a generated section."""
    found = re.search(rf"<!-- {name} -->\n(.*?)<!-- /{name} -->", README, re.DOTALL)
    assert found, f"README has no section {name}"
    return found.group(1).strip()


def test_it_is_short() -> None:
    assert len(README.encode()) <= LONGEST_BYTES


@pytest.mark.parametrize("name", re.findall(r"<!-- /([a-z -]+) -->", README))
def test_generated_sections_are_up_to_date(name: str) -> None:
    """Refresh them with `python docs/refresh_readme.py`."""
    assert section(name) == program("page_tables").part(name)


def test_refreshing_changes_stale_sections_and_nothing_else() -> None:
    refreshed = program("refresh_readme").refreshed
    assert refreshed(README) == README
    stale = README.replace(section("summary"), "stale")
    assert stale != README
    assert refreshed(stale) == README


def test_every_default_has_a_source() -> None:
    """paper, cited or our choice, for every field that is a physical or numerical choice."""
    free = {"schema", "name", "seed", "recording.enabled", "controller.poses"}
    untagged = [row.path for row in parameters() if not row.source and row.path not in free and ".kind" not in row.path]
    assert untagged == []


def test_pictures_exist() -> None:
    pictures = re.findall(r"\]\(([\w/.-]+\.(?:png|svg))\)", README)
    assert pictures
    assert all((ROOT / picture).is_file() for picture in pictures)


def test_it_says_what_it_is_not_and_whom_it_follows() -> None:
    assert "research software and no medical device" in README
    url = re.search(r'url: "(https://hal[^"]+)"', (ROOT / "CITATION.cff").read_text())
    assert url
    assert url[1] in README


def test_every_test_named_beside_an_equation_exists() -> None:
    """simcore/README.md: file::test, or a bare test of the file named before it in the same cell."""
    text = (ROOT / "simcore" / "README.md").read_text()
    missing = []
    for line in text.splitlines():
        file = None
        for name in re.findall(r"`(test_\w+\.py(?:::\w+)?|test_\w+)`", line):
            file, _, test = name.partition("::") if ".py" in name else (file, "", name)
            source = next((ROOT / "tests" / "simcore").rglob(str(file)), ROOT / "missing")
            if not source.is_file() or (test and f"def {test}(" not in source.read_text()):
                missing.append(name)
    assert missing == []
