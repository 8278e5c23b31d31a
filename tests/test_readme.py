"""The README says what the code does."""

import re
from pathlib import Path

import click
import pytest

from service.cli.main import main
from simcore.scenario.parameters import markdown_table, parameters

README = (Path(__file__).parent.parent / "README.md").read_text()


def section(name: str) -> str:
    """The text between the markers of a generated section."""
    found = re.search(rf"<!-- {name} -->\n(.*?)<!-- /{name} -->", README, re.DOTALL)
    assert found, f"README has no section {name}"
    return found.group(1).strip()


def test_parameter_table_is_that_of_the_model() -> None:
    """Refresh it with `needlebench scenario --fields`."""
    assert section("parameters") == markdown_table()


def test_every_default_has_a_source() -> None:
    """paper, cited or our choice, for every field that is a physical or numerical choice."""
    free = {"schema", "name", "seed", "recording.enabled", "controller.poses"}
    untagged = [row.path for row in parameters() if not row.source and row.path not in free and ".kind" not in row.path]
    assert untagged == []


@pytest.mark.parametrize("command", re.findall(r"^needlebench (\w+)", README, re.MULTILINE))
def test_commands_of_the_readme_exist(command: str) -> None:
    assert command in main.list_commands(click.Context(main))


def test_pictures_exist() -> None:
    pictures = re.findall(r"\]\(([\w/.-]+\.(?:png|svg))\)", README)
    assert pictures
    assert all((Path(__file__).parent.parent / picture).is_file() for picture in pictures)


def test_every_test_named_beside_an_equation_exists() -> None:
    """simcore/README.md: file::test, or a bare test of the file named before it in the same cell."""
    root = Path(__file__).parent
    text = (root.parent / "simcore" / "README.md").read_text()
    missing = []
    for line in text.splitlines():
        file = None
        for name in re.findall(r"`(test_\w+\.py(?:::\w+)?|test_\w+)`", line):
            file, _, test = name.partition("::") if ".py" in name else (file, "", name)
            source = next((root / "simcore").rglob(str(file)), root / "missing")
            if not source.is_file() or (test and f"def {test}(" not in source.read_text()):
                missing.append(name)
    assert missing == []
