"""report.html from report.json: one file without scripts or network, for screens bright and dark and for paper."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from jinja2 import Environment, FileSystemLoader, StrictUndefined
from markupsafe import Markup

from benchmarks.paper import figures
from benchmarks.paper.claims import CONTRADICTED, NOT_TESTABLE, REPRODUCED
from benchmarks.paper.table import REFERENCES, arm_name

Json = dict[str, Any]

TEMPLATES = Path(__file__).with_name("templates")
ABSENT = "–"
VERDICTS = {REPRODUCED: "✓", CONTRADICTED: "✕", NOT_TESTABLE: "○"}
NOISE = {"off": "no target noise", "on": "with target noise"}


def html(report: Json) -> str:
    """The page. report: what `document` returns, or report.json read back."""
    environment = Environment(
        loader=FileSystemLoader(TEMPLATES),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    environment.filters.update(mm=mm, percent=percent, p=p_value, arm=arm_name, interval=interval, signed=signed)
    environment.filters.update(share=share, ms=milliseconds, condition=condition)
    page: str = environment.get_template("report.html.j2").render(
        report=report,
        counts={name: sum(claim["verdict"] == name for claim in report["claims"]) for name in VERDICTS},
        symbols=VERDICTS,
        references=REFERENCES,
        conditions=[_condition(report, young, noise) for young, noise in figures.conditions(report)],
        maps=_safe(figures.maps(report)),
        bins=figures.BINS_MM,
        shades=figures.SHADES,
        bars=_safe([bars] if (bars := figures.timing_bars(report)) else []),
        seeds=_safe(figures.pictures(figures.seed_panels(report), name="s", about="Median RMSE of each ELM seed, mm.")),
        curves=_safe(
            figures.pictures(figures.learning_panels(report), name="l", about="Median and range over seeds.", width=440)
        ),
        dots=_safe(figures.sensitivity_dots(report)),
    )
    return page


def _condition(report: Json, young: str, noise: str) -> Json:
    """Everything of one condition: scores by group, pictures, which groups are at the floor."""
    scores = [s for s in report["scores"] if (s["young"], s["noise"]) == (young, noise)]
    contrasts = [c for c in report["contrasts"] if (c["young"], c["noise"]) == (young, noise)]
    groups = list(dict.fromkeys(s["group"] for s in scores))
    name = f"b-{young}-{noise}-".replace(" ", "-")
    about = "RMSE of each insertion in mm, logarithmic; medians:"
    known = {s["arm"] for s in scores}
    more = figures.box_panels(report, young, noise, arms=None) if known - set(figures.PAPER_ARMS) else []
    wide = [
        panel for panel in more if set(s["arm"] for s in scores if s["group"] == panel.title) - set(figures.PAPER_ARMS)
    ]
    return {
        "title": condition(young, noise),
        "groups": [(group, [s for s in scores if s["group"] == group]) for group in groups],
        "contrasts": contrasts,
        "floors": {c["group"] for c in contrasts if c["floor"]},
        "boxes": _safe(figures.pictures(figures.box_panels(report, young, noise), name=name, about=about)),
        "wide": _safe(figures.pictures(wide, name=f"{name}w", about=about, width=620)),
    }


def _safe(found: list[str]) -> list[Markup]:
    """Pictures are ours and escaped already."""
    return [Markup(picture) for picture in found]


# ---- numbers for people


def condition(young: str, noise: str) -> str:
    """A condition in words."""
    return f"{young} Young’s modulus, {NOISE.get(noise, noise)}"


def mm(value: float | None, absent: str = ABSENT) -> str:
    """Millimetres to the micrometre."""
    return absent if value is None else f"{value:.3f}"


def signed(value: float | None, absent: str = ABSENT) -> str:
    """A difference in millimetres, with a true minus."""
    return absent if value is None else f"{value:+.3f}".replace("-", "−")


def milliseconds(value: float | None) -> str:
    """Three significant digits."""
    if value is None:
        return ABSENT
    return f"{value:.2f}" if value >= 1.0 else f"{value:.3f}"


def percent(value: float | None, digits: int = 1) -> str:
    """A share; whole where it is whole."""
    if value is None:
        return ABSENT
    text = f"{100 * value:.{digits}f}"
    return f"{text.rstrip('0').rstrip('.') if '.' in text else text} %"


def interval(ends: list[float | None], digits: int = 3) -> str:
    """[low, high]; an open end is a failure."""
    low, high = (ABSENT if end is None else f"{end:.{digits}f}".replace("-", "−") for end in ends)
    return f"[{low}, {high}]"


def share(ends: list[float]) -> str:
    """An interval of a share, in per cent."""
    return f"[{100 * ends[0]:.1f}, {100 * ends[1]:.1f}]"


def p_value(value: float | None) -> str:
    """Two digits; very small ones as a bound."""
    if value is None:
        return ABSENT
    if value < 1e-4:
        return "< 0.0001"
    return f"{value:.4f}" if value < 0.01 else f"{value:.2f}"
