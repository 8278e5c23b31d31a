"""The named, versioned suites by name. A version never changes its meaning: the tests pin digests."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from benchmarks.cases import Case, Suite
from benchmarks.paper.scale import SCALES, Scale
from benchmarks.paper.suites import (
    Models,
    cur_cases,
    lin_cases,
    paper_cases,
    resolve_cases,
    sensitivity_cases,
    training_cases,
    young_cases,
)
from benchmarks.suites.mismatch import mismatch_cases
from simcore.errors import Problem, ScenarioError
from simcore.scenario.suggestions import did_you_mean

if TYPE_CHECKING:
    from collections.abc import Callable


@dataclass(frozen=True)
class _Kind:
    """What a suite's base name stands for."""

    title: str
    cases: Callable[[Scale, Models], list[Case]]


_KINDS = {
    "data105-v2": _Kind(
        "Training: 105 straight I-FEM insertions, noise +-0.25 mm", lambda scale, _: training_cases(scale)
    ),
    "lin100-v2": _Kind("LIN: 100 straight test paths, target noise off and on", lin_cases),
    "cur400-v2": _Kind("CUR: 100 end points x 4 sine overlays of 1.0 mm", cur_cases),
    "young-v2": _Kind("LIN and CUR at a Young's modulus of 5.5 to 6.3 kPa by path", young_cases),
    "paper-v2": _Kind("lin100-v2, cur400-v2 and young-v2 together", paper_cases),
    "sensitivity-v2": _Kind("What the paper leaves open, moved one by one", sensitivity_cases),
    "mismatch-v1": _Kind("What controllers believe is off by published spreads", mismatch_cases),
}
_OWN_MODELS = {"baselines": 0}  # their models are not bundled: a run of `needlebench paper` trains them
_SIZES = {
    size: SCALES[name].model_copy(update=_OWN_MODELS)
    for size, name in (("", "full"), ("-quick", "quick"), ("-smoke", "smoke"))
}


def suite_names() -> dict[str, str]:
    """Name -> one line on it."""
    sized = {"": "", "-quick": ", fewer and coarser", "-smoke": ", a handful and coarse"}
    return {f"{base}{size}": f"{kind.title}{sized[size]}" for base, kind in _KINDS.items() for size in _SIZES}


def suite(name: str, *, model: str = "default") -> Suite:
    """A suite by name; its ELM arms use `model`, a packaged one or a file. Raises ScenarioError for an unknown name."""
    cases = tuple(resolve_cases(drafts(name, model=model)))
    return Suite(name=name, title=suite_names()[name], cases=cases)


def drafts(name: str, *, model: str = "default") -> list[Case]:
    """Its cases before defaults: the models that they name need not exist. Raises ScenarioError for an unknown name."""
    kind, scale = _kind_and_scale(name)
    return kind.cases(scale, {"elm": model})


def _kind_and_scale(name: str) -> tuple[_Kind, Scale]:
    for base, kind in _KINDS.items():
        size = name.removeprefix(base)
        if name.startswith(base) and size in _SIZES:
            return kind, _SIZES[size]
    meant = did_you_mean(name, suite_names())
    raise ScenarioError([Problem("suite", name, f"is none of {', '.join(suite_names())}{meant}")])
