"""Performance profiles: the share of cases within each error, a line for each arm."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from markupsafe import Markup, escape

from benchmarks.paper.table import arm_name
from service.web.pictures.frame import BOTTOM, LEFT, RIGHT, SHAPES, TOP, Ruler, frame

if TYPE_CHECKING:
    from benchmarks.grid.profiles import Shares

WIDTH, HEIGHT = 560, 340  # px
MARKED = 12  # levels between two marks of a line, so that lines are told apart without their colours
HALF = 0.5


@dataclass(frozen=True, kw_only=True)
class ProfilePicture:
    """legend: class, mark and name of each arm. rows: arm, RMSE in mm within which half of the cases are (None beyond
    the last level), share within the last level."""

    cases: int
    legend: list[tuple[str, str, str]]
    rows: list[tuple[str, float | None, float]]
    svg: Markup


def profile_picture(shares: Shares | None) -> ProfilePicture | None:
    """None without errors to be drawn."""
    if shares is None or not shares.levels_mm:
        return None
    across = Ruler.of(shares.levels_mm, LEFT, WIDTH - RIGHT, log=True)
    up = Ruler.of((0.0, 1.0), HEIGHT - BOTTOM, TOP, log=False)
    parts = [
        f'<svg viewBox="0 0 {WIDTH} {HEIGHT}" role="img" aria-label="Share of {shares.cases} cases within each RMSE">',
        *frame(across, up, ("RMSE, mm", "share of cases"), WIDTH, HEIGHT),
    ]
    legend, rows = [], []
    for number, (arm, share) in enumerate(shares.share.items()):
        shape = number % len(SHAPES)
        points = [(across.at(level), up.at(value)) for level, value in zip(shares.levels_mm, share, strict=True)]
        line = "L".join(f"{x:.1f} {y:.1f}" for x, y in points)
        parts.append(f'<path class="line dot-{shape + 1}" d="M{line}"><title>{escape(arm_name(arm))}</title></path>')
        parts += [
            f'<path class="dot-{shape + 1}" d="{SHAPES[shape]}" transform="translate({x:.1f} {y:.1f})"/>'
            for x, y in points[2 * shape :: MARKED]
        ]
        legend.append((f"dot-{shape + 1}", SHAPES[shape], arm_name(arm)))
        within = next((level for level, value in zip(shares.levels_mm, share, strict=True) if value >= HALF), None)
        rows.append((arm_name(arm), within, share[-1]))
    return ProfilePicture(cases=shares.cases, legend=legend, rows=rows, svg=Markup("\n".join([*parts, "</svg>"])))
