"""The generated parts of the pages: each has a name, stands once, and comes from the code or from committed results.

A page says `<!-- generated: NAME -->` where a part belongs; `page_tables.sphinx` puts it there during the build. The
README, which nobody builds, holds its parts between `<!-- NAME -->` and `<!-- /NAME -->`; they are written by
`python docs/refresh_readme.py`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from page_tables import interfaces, model, results

if TYPE_CHECKING:
    from collections.abc import Callable

PARTS: dict[str, Callable[..., str]] = {
    "parameters": model.parameter_table,
    "metrics": model.metric_table,
    "series": model.series_table,
    "statuses": model.status_table,
    "summary": results.summary,
    "verdicts": results.verdicts,
    "paper scores": results.paper_scores,
    "paper claims": results.paper_claims,
    "paper directions": results.paper_directions,
    "paper meshes": results.paper_meshes,
    "built-in scenarios": results.builtin_scenarios,
    "discretisation": results.discretisation,
    "speed": results.speed,
    "http": interfaces.http_routes,
    "problem codes": interfaces.problem_codes,
    "commands": interfaces.commands,
    "help": interfaces.help_text,
}


def part(name: str) -> str:
    """The Markdown of a part: `paper claims`, or with an argument as in `parameters: tissue`.

    Raises KeyError for a name that there is not.
    """
    kind, _, argument = (piece.strip() for piece in name.partition(":"))
    return PARTS[kind](argument) if argument else PARTS[kind]()
