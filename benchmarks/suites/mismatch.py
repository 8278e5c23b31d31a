"""`mismatch-v1`: what controllers believe is off by published spreads, one thing at a time, then everything together.

The plant is moved and the controllers keep what they believe: I-FEM steps a model of its own at the paper's values, the
ELM is the one that was trained there. The conditions are the same for every controller. Sources marked [2nd] were read
through notes on them.
"""

from __future__ import annotations

import copy
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from benchmarks.cases import Case
from benchmarks.paper.suites import REFERENCES, Path, case_labels, controller, curved_paths, scenario, straight_paths

if TYPE_CHECKING:
    from collections.abc import Iterator

    from benchmarks.paper.scale import Scale
    from benchmarks.paper.suites import Models

Json = dict[str, Any]

STEERED = ("ifem", "elm", "frozen")
YOUNG_KPA, FRICTION, ADHESION_N_PER_MM = 6.3, 0.1, 0.01  # that controllers believe in: the defaults
SPACING_MM = 3.0
YOUNG_SPREAD = 0.20  # of E: Adagolodjo et al. 2019 [2nd]; Baksic et al. 2020 draw within 0.13 [2nd]
FRICTION_SPREAD = 4.3 / 10.6  # along a needle in bovine liver, 10.6 +- 4.3 N/m: Okamura et al. 2004 [2nd]
RATE_HZ = (20.0, 5.0)  # images of the needle: 20 a second in Baksic et al. 2020, which diverges below 3 [2nd]
FRAME_S = 0.05  # one image at that rate: what is seen, and what is commanded, comes so late
NOISE_MM = 0.144  # standard deviation of the paper's uniform +-0.25 mm


@dataclass(frozen=True)
class Condition:
    """What of the plant, or of what is seen of it, is off. changes: blocks of the scenario; delay_s: of commands."""

    name: str
    text: str
    changes: Json = field(default_factory=dict)
    delay_s: float = 0.0


def _young(factor: float) -> Json:
    return {"tissue": {"young_kpa": round(YOUNG_KPA * factor, 4)}}


def _friction(factor: float) -> Json:
    return {
        "interaction": {
            "friction": round(FRICTION * factor, 4),
            "adhesion_n_per_mm": round(ADHESION_N_PER_MM * factor, 5),
        }
    }


def _seen(**sensing: float) -> Json:
    return {"sensing": sensing}


CONDITIONS = (
    Condition("nominal", "the plant is what controllers believe"),
    Condition("soft", "E 20 % below", _young(1.0 - YOUNG_SPREAD)),
    Condition("stiff", "E 20 % above", _young(1.0 + YOUNG_SPREAD)),
    Condition("smooth", "friction and adhesion 41 % below", _friction(1.0 - FRICTION_SPREAD)),
    Condition("sticky", "friction and adhesion 41 % above", _friction(1.0 + FRICTION_SPREAD)),
    Condition("fine", "constraint points half as far apart as in models", {"interaction": {"spacing_mm": 1.5}}),
    Condition("rate-20", "20 images of the tip a second", _seen(rate_hz=RATE_HZ[0])),
    Condition("rate-5", "5 images of the tip a second", _seen(rate_hz=RATE_HZ[1])),
    Condition("late-image", "the tip is seen 50 ms late", _seen(latency_s=FRAME_S)),
    Condition("late-command", "commands are executed 50 ms late", delay_s=FRAME_S),
    Condition("noise", "normal noise of 0.144 mm on the tip", _seen(noise_mm=NOISE_MM)),
    Condition(
        "all",
        "stiff, sticky, fine, 20 images a second seen and commands executed 50 ms late, noise",
        {
            **_young(1.0 + YOUNG_SPREAD),
            "interaction": {**_friction(1.0 + FRICTION_SPREAD)["interaction"], "spacing_mm": 1.5},
            **_seen(rate_hz=RATE_HZ[0], latency_s=FRAME_S, noise_mm=NOISE_MM),
        },
        FRAME_S,
    ),
)
END_POINTS = {"full": 20, "quick": 3, "smoke": 1}  # by scale, each with a straight and a curved path
SMOKE = ("nominal", "stiff", "all")  # the conditions of the smallest form
FITTING_DT_S = (0.01, 0.05)  # time steps that have images at 5 and 20 Hz, and 50 ms, as whole numbers of steps
FIRST_SEED = 30_000  # plus the number of the path: the same noise for every controller


def mismatch_cases(scale: Scale, models: Models) -> list[Case]:
    """Every controller along every path in every condition, at a time step of which 50 ms are a multiple."""
    if scale.dt_s not in FITTING_DT_S:
        scale = scale.model_copy(update={"dt_s": FITTING_DT_S[0]})
    chosen = [one for one in CONDITIONS if scale.name != "smoke" or one.name in SMOKE]
    cases = []
    for condition in chosen:
        for number, path in enumerate(_paths(END_POINTS[scale.name])):
            for arm in (*STEERED, *REFERENCES):
                cases.append(_case(condition, number, path, arm, scale, models))
    return cases


def _paths(end_points: int) -> Iterator[Path]:
    for straight, curved in zip(straight_paths(end_points), curved_paths(end_points, 1), strict=True):
        yield straight
        yield curved


def _case(condition: Condition, number: int, path: Path, arm: str, scale: Scale, models: Models) -> Case:
    name = f"{condition.name}-{path.name}-{arm}"
    block = {**controller(arm, scale, models), "delay_s": condition.delay_s}
    if arm == "ifem":
        block["model"] = {"kind": "separate"}
    if arm in ("ifem", "frozen"):
        block["model"] |= believed(scale)
    changes = copy.deepcopy(condition.changes)
    interaction = {"spacing_mm": SPACING_MM, **changes.pop("interaction", {})}
    blocks = {**changes, "interaction": interaction, "trajectory": path.trajectory(), "controller": block}
    data = scenario(name, scale, seed=FIRST_SEED + number, **blocks)
    return Case(name, data, case_labels(path, arm, "main", condition=condition.name))


def believed(scale: Scale) -> Json:
    """The tissue of a controller's own model."""
    return {
        "young_kpa": YOUNG_KPA,
        "friction": FRICTION,
        "element_size_mm": scale.element_size_mm,
        "spacing_mm": SPACING_MM,
    }
