"""The pieces of an SVG document: colours, texts, numbers, and the document around drawn parts."""

from __future__ import annotations

from collections.abc import Sequence
from xml.sax.saxutils import escape

COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#555555", "#8c6d31")  # Okabe and Ito
INK, PALE, GRID = "#222222", "#666666", "#e4e4e4"
FONT = "font-family='system-ui, -apple-system, Segoe UI, Helvetica, Arial, sans-serif'"


def picture(
    parts: Sequence[str], *, width: int, height: int, name: str = "c", about: tuple[str, str] | None = None
) -> str:
    """The SVG document around drawn parts. about: what it is and what it shows, for those who cannot see it."""
    labels = f" aria-labelledby='{name}-t {name}-d'" if about else ""
    head = [
        f"<svg xmlns='http://www.w3.org/2000/svg' viewBox='0 0 {width} {height}' width='{width}' height='{height}' "
        f"role='img'{labels} {FONT} font-size='11'>",
    ]
    if about:
        head += [f"<title id='{name}-t'>{escape(about[0])}</title>", f"<desc id='{name}-d'>{escape(about[1])}</desc>"]
    head.append(f"<rect class='paper' width='{width}' height='{height}' fill='white'/>")
    return "\n".join([*head, *parts, "</svg>"]) + "\n"


def text(
    x: float,
    y: float,
    words: str,
    *,
    anchor: str = "start",
    size: int = 11,
    weight: int = 400,
    fill: str = INK,
    turned: bool = False,
) -> str:
    """One line of text; nothing for no words."""
    if not words:
        return ""
    turn = f" transform='rotate(-90 {x:.1f} {y:.1f})'" if turned else ""
    shade = {INK: "class='ink' ", PALE: "class='pale' "}.get(fill, "")
    style = f"{shade}text-anchor='{anchor}' font-size='{size}' font-weight='{weight}' fill='{fill}'"
    return f"<text x='{x:.1f}' y='{y:.1f}' {style}{turn}>{escape(words)}</text>"


def number(value: float) -> str:
    """A tick label: plain where that is short, else a power of ten."""
    if value == 0.0 or 1e-3 <= abs(value) < 1e5:
        return f"{value:.6g}"
    mantissa, exponent = f"{value:.3e}".split("e")
    factor = f"{float(mantissa):g}"
    raised = str(int(exponent)).translate(str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"))
    return f"10{raised}" if factor == "1" else f"{factor}·10{raised}"
