"""Arms in the plane of error and cost: a line through those that no other arm beats, hollow marks for the others."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from markupsafe import Markup, escape

from benchmarks.paper.table import arm_name
from service.web.pictures.frame import SHAPES, frame, rulers, text

if TYPE_CHECKING:
    from collections.abc import Sequence

    from service.campaigns.fronts import Front

WIDTH, HEIGHT = 460, 300  # px
_LETTER = 8.0  # px, mean width of one


@dataclass(frozen=True, kw_only=True)
class FrontPicture:
    """sentence: what the picture shows, in words."""

    front: Front
    sentence: str
    svg: Markup


def front_pictures(fronts: Sequence[Front]) -> list[FrontPicture]:
    """One picture each."""
    return [FrontPicture(front=front, sentence=_sentence(front), svg=_svg(front)) for front in fronts]


def _sentence(front: Front) -> str:
    on = f"On the front: {', '.join(arm_name(place.arm) for place in front.best)}."
    beaten = [
        f"{arm_name(place.arm)} is beaten by {', '.join(map(arm_name, place.beaten_by))}." for place in front.beaten
    ]
    absent = ", ".join(map(arm_name, front.absent))
    return " ".join([on, *beaten, *([f"Without a place, as a number is missing: {absent}."] if absent else [])])


def _svg(front: Front) -> Markup:
    across, up = rulers([p.paid for p in front.places], [p.error_mm for p in front.places], WIDTH, HEIGHT)
    about = escape(f"Median RMSE over {front.heading}. {_sentence(front)}")
    parts = [
        f'<svg viewBox="0 0 {WIDTH} {HEIGHT}" role="img" aria-label="{about}">',
        *frame(across, up, (f"{front.heading}, median of the largest", "RMSE, mm, median"), WIDTH, HEIGHT),
    ]
    corners = [(across.at(place.paid), up.at(place.error_mm)) for place in front.best]
    steps = "".join(f"H{x:.1f}V{y:.1f}" for x, y in corners[1:])  # between two arms nothing better is known
    parts.append(f'<path class="front" d="M{corners[0][0]:.1f} {corners[0][1]:.1f}{steps}"/>')
    for number, place in enumerate(front.places):
        x, y = across.at(place.paid), up.at(place.error_mm)
        hollow = " hollow" if place.beaten_by else ""
        shape = number % len(SHAPES)
        mark = f'<path class="dot-{shape + 1}{hollow}" d="{SHAPES[shape]}" transform="translate({x:.1f} {y:.1f})">'
        words = arm_name(place.arm)
        fits = x + 9 + _LETTER * len(words) < WIDTH
        tip = escape(f"{words}: {place.error_mm:.3g} mm, {front.heading} {place.paid:.3g}")
        parts.append(f"{mark}<title>{tip}</title></path>")
        parts.append(text(x + (9 if fits else -9), y - 7, words, "start" if fits else "end"))
    return Markup("\n".join([*parts, "</svg>"]))
