"""The code blocks of the README and of the documentation, where each stands and whether it is run."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING

from tests.docs.sources import DOCS, ROOT

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

FENCE = re.compile(r"^```(\w*)$")
DIRECTIVE = re.compile(r"^(`{3,}|:{3,})\{")
NOT_RUN = re.compile(r"^<!-- not run: (.+) -->$")
AT_THE_ROOT = ("README.md", "ARCHITECTURE.md", "CONTRIBUTING.md", "SECURITY.md", "CHANGELOG.md")
LANGUAGES = ("shell", "python", "json", "toml", "text")


@dataclass(frozen=True)
class Snippet:
    """One block. line: of its opening fence, from 1. not_run: why it is not run, None = it is."""

    page: Path
    line: int
    language: str
    text: str
    not_run: str | None

    def __str__(self) -> str:
        return f"{self.page.relative_to(ROOT)}:{self.line}"

    @property
    def commands(self) -> list[str]:
        """The lines of a shell block without comments, continued lines joined."""
        joined = self.text.replace("\\\n", " ")
        return [line.strip() for line in joined.splitlines() if line.strip() and not line.startswith("#")]

    @property
    def serves(self) -> bool:
        """Whether it starts a service that the blocks after it talk to."""
        return self.language == "shell" and [line.split()[:2] for line in self.commands] == [["needlebench", "serve"]]


def pages() -> list[Path]:
    """The README, the pages at the root that the site includes, and those of docs/."""
    return [*(ROOT / name for name in AT_THE_ROOT), *sorted(DOCS.glob("*.md"))]


def snippets(page: Path) -> list[Snippet]:
    """The blocks of a page, in order; directives of Sphinx are no snippets."""
    return list(_blocks(page, page.read_text(encoding="utf-8").splitlines()))


def _blocks(page: Path, lines: list[str]) -> Iterator[Snippet]:
    number = 0
    while number < len(lines):
        opened = FENCE.match(lines[number])
        if DIRECTIVE.match(lines[number]):
            number = _end(lines, number)
        elif opened:
            end = _end(lines, number)
            reason = NOT_RUN.match(lines[number - 1]) if number else None
            text = "\n".join(lines[number + 1 : end]) + "\n"
            yield Snippet(page, number + 1, opened[1], text, reason[1] if reason else None)
            number = end
        number += 1


def _end(lines: list[str], opening: int) -> int:
    """The line of the closing fence."""
    mark = lines[opening].partition("{")[0].rstrip("abcdefghijklmnopqrstuvwxyz")
    for number in range(opening + 1, len(lines)):
        if lines[number] == mark:
            return number
    raise AssertionError(f"line {opening + 1}: {lines[opening]} has no end")
