"""The experiments as lists of scenarios: those of Perrusi et al. 2021, and what is studied around them.

`benchmarks/suites/catalogue.py` has them by name: `lin100-v2`, `cur400-v2`, `young-v2` and `paper-v2`, which is the
three together; `-quick` and `-smoke` after the version are smaller forms.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from benchmarks.cases import Case, Label
from benchmarks.learning.training_insertions import NOISE_MM, training_insertions
from benchmarks.paper.sampling import DIRECTIONS, ENTRY_MM, end_points_mm, young_kpa
from benchmarks.paper.variations import VARIATIONS, apply_variation
from simcore.errors import Problem, ScenarioError
from simcore.scenario.scenario import Scenario

if TYPE_CHECKING:
    from benchmarks.paper.scale import ExperimentScale, Scale

Models = Mapping[str, str]  # learned kind of controller -> its model; "default" where none is named
Json = dict[str, Any]

STEERED = ("ifem", "elm")
REFERENCES = ("open_loop", "rigid")
BASELINES = ("frozen", "linear", "neighbours", "mlp")
LEARNED = ("elm", "linear", "neighbours", "mlp")
AMPLITUDE_MM = 1.0
NOMINAL_KPA = 6.3  # [paper] the Young's modulus that the controllers know
TEST_NOISE_SEED = 20_000  # plus the number of the path: the same noise for every arm
SIGNS = tuple(DIRECTIONS)


@dataclass(frozen=True)
class Path:
    """A test path: its end point, and along which axis its sine goes ("" = straight)."""

    end_point: int
    direction: str = ""

    @property
    def group(self) -> str:
        """LIN or CUR."""
        return "CUR" if self.direction else "LIN"

    @property
    def name(self) -> str:
        """As it begins the ids of its cases."""
        return f"{self.group.lower()}-{self.end_point:03}{self.direction}"

    def trajectory(self) -> Json:
        """The scenario's block."""
        target = end_points_mm()[self.end_point].tolist()
        if not self.direction:
            return {"kind": "line", "entry_mm": list(ENTRY_MM), "target_mm": target}
        overlay = {"amplitude_mm": AMPLITUDE_MM, "periods": 1.0, "direction": list(DIRECTIONS[self.direction])}
        return {"kind": "sine", "entry_mm": list(ENTRY_MM), "target_mm": target, **overlay}


def straight_paths(count: int) -> list[Path]:
    """LIN: one path to each of the first end points."""
    return [Path(i) for i in range(count)]


def curved_paths(count: int, directions: int = 4) -> list[Path]:
    """CUR: the same end points, each along some directions; fewer than four are taken in turn."""
    return [Path(i, SIGNS[(i + k) % 4]) for i in range(count) for k in range(directions)]


# ---- scenarios and cases


def scenario(name: str, scale: ExperimentScale, *, seed: int, noise_mm: float = 0.0, **blocks: Json) -> Json:
    """A scenario of the experiments before defaults; `blocks` adds fields to its blocks."""
    shared = discretisation(scale)
    shared["tissue"] |= blocks.pop("tissue", {})
    return {"name": name, "seed": seed, "noise_mm": noise_mm, "recording": {"enabled": False}, **shared, **blocks}


def discretisation(scale: ExperimentScale) -> Json:
    """The fields of every scenario that the scale settles."""
    return {"dt_s": scale.dt_s, "tissue": {"element_size_mm": scale.element_size_mm}}


def resolve_cases(drafts: Sequence[Case]) -> list[Case]:
    """The cases with every field of their scenarios settled. Raises ScenarioError, naming the case.

    A learned controller's model must exist for that; a draft only names it.
    """
    cases = []
    for draft in drafts:
        try:
            cases.append(Case(draft.id, Scenario.load(draft.scenario).resolved(), draft.labels))
        except ScenarioError as error:
            problems = [Problem(f"{draft.id}: {p.field}", p.value, p.message) for p in error.problems]
            raise ScenarioError(problems) from None
    return cases


def controller(arm: str, scale: Scale, models: Models) -> Json:
    """The scenario's controller block of an arm."""
    if arm in LEARNED:
        return {"kind": arm, "model": models.get(arm, "default")}
    if arm == "frozen":
        return {"kind": arm, "model": {"kind": "separate", "element_size_mm": scale.element_size_mm}}
    return {"kind": arm}


def case_labels(path: Path, arm: str, purpose: str, **more: Label) -> dict[str, Label]:
    """What the analyses sort by."""
    return {
        "purpose": purpose,
        "group": path.group,
        "arm": arm,
        "young": "constant",
        "noise": "off",
        "end_point": path.end_point,
        "direction": path.direction,
        **more,
    }


def cases_along(
    scale: Scale, models: Models, paths: Sequence[Path], arms: Sequence[str], purpose: str = "main"
) -> list[Case]:
    """Every arm along every path, path by path: constant stiffness, no noise."""
    cases = []
    for path in paths:
        for arm in arms:
            name = f"{path.name}-{arm}"
            data = scenario(
                name, scale, seed=0, trajectory=path.trajectory(), controller=controller(arm, scale, models)
            )
            cases.append(Case(name, data, case_labels(path, arm, purpose)))
    return cases


# ---- the experiments


def training_cases(scale: ExperimentScale) -> list[Case]:
    """The data set: straight I-FEM insertions to the training grid with uniform target noise of +-0.25 mm."""
    return list(training_insertions(insertions=scale.training, seed=0, changes=discretisation(scale)))


def lin_cases(scale: Scale, models: Models) -> list[Case]:
    """LIN: straight test paths, noise off (primary), then with target noise on."""
    cases = cases_along(scale, models, straight_paths(scale.lin), STEERED)
    cases += cases_along(scale, models, straight_paths(scale.reference_lin), REFERENCES)
    cases += cases_along(scale, models, straight_paths(scale.baselines), BASELINES)
    for path in straight_paths(scale.noise):
        for arm in (*STEERED, *REFERENCES):
            name = f"lin-noise-{path.end_point:03}-{arm}"
            seed, block = TEST_NOISE_SEED + path.end_point, controller(arm, scale, models)
            data = scenario(name, scale, seed=seed, noise_mm=NOISE_MM, trajectory=path.trajectory(), controller=block)
            cases.append(Case(name, data, case_labels(path, arm, "main", noise="on")))
    return cases


def cur_cases(scale: Scale, models: Models) -> list[Case]:
    """CUR: four sine overlays over each end point."""
    cases = cases_along(scale, models, curved_paths(scale.cur), STEERED)
    cases += cases_along(scale, models, curved_paths(scale.reference_cur, scale.reference_directions), REFERENCES)
    return cases + cases_along(scale, models, curved_paths(scale.baselines, 1), BASELINES)


def young_cases(scale: Scale, models: Models) -> list[Case]:
    """The same paths, Young's modulus 5.5 to 6.3 kPa by path: the ELM on all, the references on some."""
    everything = [*straight_paths(scale.young), *curved_paths(scale.young)]
    some = [*straight_paths(scale.reference_young), *curved_paths(scale.reference_young, scale.reference_directions)]
    return [
        _young_case(path, arm, scale, controller(arm, scale, models))
        for path, arm in [*pairs(everything, ("elm",)), *pairs(some, REFERENCES)]
    ]


def nominal_ifem_cases(scale: Scale) -> list[Case]:
    """I-FEM along some of these paths, with a model of its own that has the nominal modulus. In no suite: the paper
    counts none of them, yet compares with them."""
    nominal = {"kind": "separate", "young_kpa": NOMINAL_KPA, "element_size_mm": scale.element_size_mm}
    paths = [*straight_paths(scale.young_ifem), *curved_paths(scale.young_ifem)]
    return [_young_case(path, "ifem", scale, {"kind": "ifem", "model": dict(nominal)}) for path in paths]


def _young_case(path: Path, arm: str, scale: Scale, block: Json) -> Case:
    name = f"young-{path.name}-{arm}"
    tissue = {"young_kpa": young_kpa(path.end_point, path.direction)}
    data = scenario(name, scale, seed=0, tissue=tissue, trajectory=path.trajectory(), controller=block)
    return Case(name, data, case_labels(path, arm, "main", young="variable"))


def paper_cases(scale: Scale, models: Models) -> list[Case]:
    """LIN, CUR and variable stiffness."""
    return [*lin_cases(scale, models), *cur_cases(scale, models), *young_cases(scale, models)]


def sensitivity_cases(scale: Scale, models: Models) -> list[Case]:
    """Each open parameter moved alone, along the same few paths as the nominal values."""
    paths = [*straight_paths(scale.sensitivity_lin), *curved_paths(scale.sensitivity_cur, 1)]
    cases = []
    for variation in VARIATIONS:
        arms = ("ifem",) if variation.ifem_only else (*STEERED, "open_loop")
        for path, arm in pairs(paths, arms):
            name = f"sens-{variation.name}-{path.name}-{arm}"
            data = scenario(
                name, scale, seed=0, trajectory=path.trajectory(), controller=controller(arm, scale, models)
            )
            more = {"parameter": variation.parameter, "value": variation.value}
            cases.append(Case(name, apply_variation(data, variation), case_labels(path, arm, "sensitivity", **more)))
    return cases


def seed_cases(scale: Scale, models: Sequence[str]) -> list[Case]:
    """ELMs that differ in their random input weights alone, closed loop, along the same paths: LIN and CUR in turn, the
    first ones of those along which the references run."""
    both = zip(straight_paths(scale.seed_paths), curved_paths(scale.seed_paths, 1), strict=True)
    paths = [path for pair in both for path in pair][: scale.seed_paths]
    cases = []
    for seed, model in enumerate(models):
        for case in cases_along(scale, {"elm": model}, paths, ("elm",), "seeds"):
            name = f"seed-{seed:02}-{case.id}"
            cases.append(Case(name, {**case.scenario, "name": name}, {**case.labels, "model_seed": seed}))
    return cases


def timing_cases(scale: Scale, models: Models) -> list[Case]:
    """Short list for one worker: the arms whose times are compared, interleaved, so that all see the same machine. The
    references show what a step costs without any steering."""
    paths = [Path(i, "" if i % 2 == 0 else SIGNS[i // 2 % 4]) for i in range(scale.timing)]
    ways = {
        "constraint": {"kind": "ifem", "jacobian": "constraint"},
        "perturbation": {"kind": "ifem", "jacobian": "perturbation"},
        "elm": controller("elm", scale, models),
        **{arm: controller(arm, scale, models) for arm in REFERENCES},
    }
    cases = []
    for path in paths:
        for way, block in ways.items():
            name = f"timing-{path.name}-{way}"
            data = scenario(name, scale, seed=0, trajectory=path.trajectory(), controller=block)
            cases.append(Case(name, data, case_labels(path, block["kind"], "timing", jacobian=way)))
    return cases


def pairs(paths: Sequence[Path], arms: Sequence[str]) -> Iterator[tuple[Path, str]]:
    """Every arm along every path, path by path."""
    return ((path, arm) for path in paths for arm in arms)
