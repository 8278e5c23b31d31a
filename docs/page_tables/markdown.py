"""Tables and numbers in Markdown."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence


def table(head: Sequence[str], rows: Iterable[Sequence[str]], *, numbers: Sequence[int] = ()) -> str:
    """A table; the columns whose places are in `numbers` are set flush right."""
    rules = ["---:" if place in numbers else "---" for place in range(len(head))]
    lines = ["| " + " | ".join(head) + " |", "| " + " | ".join(rules) + " |"]
    lines += ["| " + " | ".join(cell.replace("|", "\\|") for cell in row) + " |" for row in rows]
    return "\n".join(lines)


SPACE = "\u00a0"  # that no line breaks at


def percent(share: float) -> str:
    """A share to four digits, no more than it needs: 100 %, 90.25 %."""
    return f"{100.0 * share:.4g}{SPACE}%"


def signed_percent(ratio: float) -> str:
    """By how much a ratio is off one, with a true minus."""
    change = 100.0 * (ratio - 1.0)
    text = f"{change:+.1f}" if abs(change) < 9.95 else f"{change:+.0f}"
    return ("0" if float(text) == 0.0 else text.replace("-", "−")) + f"{SPACE}%"
