"""Writes the generated tables of README.md again, between their marks: `python docs/refresh_readme.py`."""

from __future__ import annotations

import re
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT), str(ROOT / "docs")]
MARKED = re.compile(r"<!-- ([a-z][a-z -]*) -->\n.*?<!-- /\1 -->", re.DOTALL)


def refreshed(text: str) -> str:
    """The text with every marked part made again."""
    from page_tables import part

    return MARKED.sub(lambda mark: f"<!-- {mark[1]} -->\n{part(mark[1])}\n<!-- /{mark[1]} -->", text)


def main() -> None:
    """Change README.md in place."""
    readme = ROOT / "README.md"
    readme.write_text(refreshed(readme.read_text(encoding="utf-8")), encoding="utf-8", newline="\n")


if __name__ == "__main__":
    main()
