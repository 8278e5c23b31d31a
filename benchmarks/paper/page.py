"""report.html from report.json: one file without scripts or network, for screens bright and dark and for paper."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from jinja2 import Environment, FileSystemLoader, StrictUndefined

from benchmarks.paper import figures, number_text
from benchmarks.paper.evidence import NOT_REPRODUCED, REPRODUCED, UNDECIDED
from benchmarks.paper.table import ALL, BESIDE, GROUPS, REFERENCES, arm_name

Json = dict[str, Any]

TEMPLATES = Path(__file__).with_name("templates")
ABSENT = "–"
VERDICTS = {REPRODUCED: "✓", NOT_REPRODUCED: "✕", UNDECIDED: "○"}
NOISE = {"off": "no target noise", "on": "with target noise"}


def html(report: Json) -> str:
    """The page. report: what `document` returns, or report.json read back."""
    return render(
        "report.html.j2",
        report=report,
        counts={name: sum(claim["verdict"] == name for claim in report["claims"]) for name in VERDICTS},
        symbols=VERDICTS,
        references=REFERENCES,
        conditions=[_condition(report, *held, f"b{i}-") for i, held in enumerate(figures.conditions(report))],
        maps=figures.maps(report),
        bins=figures.BINS_MM,
        shades=figures.SHADES,
        bars=[bars] if (bars := figures.timing_bars(report)) else [],
        seeds=figures.pictures(figures.seed_panels(report), name="s", about="Median RMSE of each ELM seed, mm."),
        curves=figures.pictures(figures.learning_panels(report), name="l", about="Median and range over seeds."),
        dots=figures.sensitivity_dots(report),
        few={
            group: max((v["paths"] for v in report["sensitivity"] if v["group"] == group), default=0)
            for group in GROUPS
        },
    )


def render(template: str, **content: Any) -> str:
    """A page from one of the templates, with the filters for numbers."""
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
    environment.filters.update(plain=plain)
    environment.globals.update(BESIDE=BESIDE, quartiles=quartiles)
    environment.filters.update(change=change, change_interval=change_interval)
    page: str = environment.get_template(template).render(**content)
    return page


def _condition(report: Json, young: str, noise: str, name: str) -> Json:
    """Everything of one condition: scores by group, pictures, which groups are at the floor. name: begins their ids."""
    scores = [s for s in report["scores"] if (s["young"], s["noise"]) == (young, noise)]
    contrasts = [c for c in report["contrasts"] if (c["young"], c["noise"]) == (young, noise)]
    groups = list(dict.fromkeys(s["group"] for s in scores))
    about = "RMSE of each insertion in mm, logarithmic; medians:"
    more = [
        panel
        for panel in figures.box_panels(report, young, noise, arms=None)
        if panel.title != ALL and {s["arm"] for s in scores if s["group"] == panel.title} - set(figures.PAPER_ARMS)
    ]
    return {
        "title": condition(young, noise),
        "groups": [(group, [s for s in scores if s["group"] == group]) for group in groups],
        "contrasts": contrasts,
        "floors": {c["group"] for c in contrasts if c["floor"]},
        "boxes": figures.pictures(figures.box_panels(report, young, noise), name=name, about=about),
        "wide": figures.pictures(more, name=f"{name}w", about=about, width=525, height=320),
    }


# ---- numbers for people


def condition(young: str, noise: str) -> str:
    """A condition in words."""
    return f"{young[:1].upper()}{young[1:]} Young’s modulus, {NOISE.get(noise, noise)}"


def mm(value: float | None, absent: str = ABSENT) -> str:
    """Millimetres to the micrometre, one more digit below ten."""
    return absent if value is None else number_text.error_text(value)


def plain(value: float | None, digits: int) -> str:
    """A number with so many decimals."""
    return ABSENT if value is None else f"{value:.{digits}f}"


def signed(value: float | None, absent: str = ABSENT) -> str:
    """A difference in millimetres, with a true minus."""
    return absent if value is None else number_text.signed_text(value)


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


def interval(ends: list[float | None], digits: int | None = None) -> str:
    """[low, high], as errors are written or with so many digits; an open end is a failure."""
    low, high = (number_text.error_text(end) if end is None or digits is None else f"{end:.{digits}f}" for end in ends)
    return f"[{low}, {high}]".replace("-", "−")


def quartiles(low: float | None, high: float | None) -> str:
    """The range between, one word where both are failures."""
    return "failed" if low is None and high is None else f"{mm(low, 'failed')} – {mm(high, 'failed')}"


def change(contrast: Json) -> str:
    """The median difference of a comparison, infinite between failures and others."""
    value = contrast["difference_mm"]
    return signed(value, _endless(contrast))


def change_interval(contrast: Json, digits: int = 3) -> str:
    """Its interval, [low, high]."""
    low, high = contrast["difference_interval_mm"]
    if low is None and high is None and contrast["difference_mm"] is None:
        return f"[{_endless(contrast)}, {_endless(contrast)}]"
    ends = ("−∞" if low is None else f"{low:.{digits}f}", "+∞" if high is None else f"{high:.{digits}f}")
    return f"[{', '.join(ends)}]".replace("-", "−")


def _endless(contrast: Json) -> str:
    return "−∞" if contrast["clusters_below"] > contrast["clusters_above"] else "+∞"


def share(ends: list[float]) -> str:
    """An interval of a share, in per cent."""
    return f"[{100 * ends[0]:.1f}, {100 * ends[1]:.1f}]".replace("-", "−")


def p_value(value: float | None) -> str:
    """Two digits; very small ones as a bound."""
    if value is None:
        return ABSENT
    if value < 1e-4:
        return "< 0.0001"
    return f"{value:.4f}" if value < 0.01 else f"{value:.3f}" if value < 0.1 else f"{value:.2f}"
