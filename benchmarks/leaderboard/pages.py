"""The pages of a leaderboard: without scripts or network, in the looks of the paper's report."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from benchmarks.grid.page import profile_panels
from benchmarks.paper.figures import pictures
from benchmarks.paper.page import render

if TYPE_CHECKING:
    from collections.abc import Iterator

Json = dict[str, Any]
INDEX = "index.html"


def pages(boards: Json, *, title: str) -> Iterator[tuple[str, str]]:
    """(name, text) of each page of a site. boards: what `boards.document` returns, or its JSON read back."""
    yield INDEX, render("leaderboards.html.j2", report=boards, title=title)
    for board in boards["boards"]:
        bundles = {one["id"]: one for one in board["bundles"]}
        profile = pictures(profile_panels(board["profiles"]), name="p", about="Share of cases.", width=720, height=360)
        content = {"board": board, "bundles": bundles, "profile": profile, "rules": boards["rules"], "title": title}
        yield board["file"], render("leaderboard.html.j2", **content)
