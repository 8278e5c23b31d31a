"""The named suites: their content, their names, and that a version never changes.

After an intended change (of a packaged model, of a default, of a suite under a new version) write the digests anew:
    python -m tests.benchmarks.paper.test_suites
"""

from __future__ import annotations

import json
import re
from collections import Counter
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from benchmarks.cases import Case, Label, Outcome
from benchmarks.paper import suites
from benchmarks.paper.learning import LearningCurves
from benchmarks.paper.pipeline import Findings, paper_outcomes
from benchmarks.paper.plan import Plan, StepCost, experiments
from benchmarks.paper.retraining import LABEL, training_conditions, training_scores
from benchmarks.paper.sampling import end_points_mm, young_kpa
from benchmarks.paper.scale import SCALE_TEXT, SCALES, Scale, scale_of
from benchmarks.paper.table import rows
from benchmarks.paper.training_study import other_training_cases, quiet_cases, training_study_cases
from benchmarks.paper.variations import VARIATIONS, apply_variation
from benchmarks.suites import catalogue
from simcore.errors import ScenarioError
from simcore.learning.trained import PACKAGED
from simcore.scenario.scenario import Scenario

if TYPE_CHECKING:
    from collections.abc import Sequence

PINNED = Path(__file__).with_name("suites.json")
MODELS = {"elm": "models/elm-00.json"}


def digests() -> dict[str, str]:
    """Digest of every suite that needs no model but those that come along."""
    return {name: catalogue.suite(name).sha256 for name in catalogue.suite_names() if needs(name) <= packaged()}


def needs(name: str) -> set[str]:
    drafts = catalogue.drafts(name)
    return {case.scenario["controller"]["kind"] for case in drafts} & set(suites.LEARNED)


def packaged() -> set[str]:
    return {kind for kind in suites.LEARNED if (PACKAGED / f"{kind}.json").exists()}


@pytest.mark.slow
def test_no_suite_has_changed() -> None:
    pinned = json.loads(PINNED.read_text())
    assert {name: digest for name, digest in digests().items() if pinned.get(name) != digest} == {}
    assert set(pinned) <= set(catalogue.suite_names())


@pytest.mark.parametrize("name", catalogue.suite_names())
def test_ids_are_unique_and_good_as_file_names(name: str) -> None:
    ids = [case.id for case in catalogue.drafts(name)]
    assert len(ids) == len(set(map(str.lower, ids))) > 0
    assert not [case_id for case_id in ids if not re.fullmatch(r"[A-Za-z0-9._+-]{1,80}", case_id)]


def counted(scale: Scale, **labels: str) -> int:
    return sum(
        all(case.labels[key] == value for key, value in labels.items()) for case in suites.paper_cases(scale, MODELS)
    )


@pytest.mark.slow
def test_full_is_the_paper() -> None:
    full = SCALES["full"]
    plain = {"young": "constant", "noise": "off"}
    assert len(suites.training_cases(full)) == 105
    for arm in ("ifem", "elm"):
        assert counted(full, group="LIN", arm=arm, **plain) == 100
        assert counted(full, group="CUR", arm=arm, **plain) == 400
    assert counted(full, arm="elm", young="variable") == 500
    assert len(suites.nominal_ifem_cases(SCALES["extended"])) == 500
    assert full.seeds >= 20


@pytest.mark.slow
@pytest.mark.parametrize("scale", SCALES.values(), ids=SCALES)
def test_every_table_has_its_reference_rows(scale: Scale) -> None:
    tables = Counter(
        (c.labels["group"], c.labels["young"], c.labels["noise"]) for c in suites.paper_cases(scale, MODELS)
    )
    for group, young, noise in tables:
        for arm in suites.REFERENCES:
            assert counted(scale, group=str(group), young=str(young), noise=str(noise), arm=arm) > 0


def test_arms_are_paired() -> None:
    """The same path, noise and stiffness for every arm: only the controller differs."""
    seen: dict[tuple[object, ...], str] = {}
    for case in suites.paper_cases(SCALES["quick"], MODELS):
        key = tuple(case.labels[name] for name in ("group", "young", "noise", "end_point", "direction"))
        rest = {k: v for k, v in case.scenario.items() if k not in ("controller", "name")}
        assert seen.setdefault(key, json.dumps(rest, sort_keys=True)) == json.dumps(rest, sort_keys=True)


def test_at_variable_stiffness_ifem_steers_by_its_nominal_model_along_paths_of_the_elm() -> None:
    scale = SCALES["full"]
    learned = {_along(case): case.scenario["tissue"] for case in suites.young_cases(scale, MODELS)}
    known = suites.nominal_ifem_cases(scale)
    assert len(known) == 5 * scale.young_ifem > 100
    for case in known:
        assert case.scenario["controller"]["model"]["young_kpa"] == 6.3
        assert case.scenario["tissue"] == learned[_along(case)]
    own = [case for case in experiments(scale) if case.labels["young"] == "variable" and case.labels["arm"] == "ifem"]
    assert own == known


def _along(case: Case) -> tuple[object, ...]:
    return tuple(case.labels[name] for name in ("group", "end_point", "direction"))


def test_a_curved_case_is_what_its_id_says() -> None:
    (case,) = [c for c in suites.young_cases(SCALES["full"], MODELS) if c.id == "young-cur-017-y-elm"]
    assert case.scenario["trajectory"]["direction"] == [0.0, -1.0, 0.0]
    assert case.scenario["trajectory"]["target_mm"] == end_points_mm()[17].tolist()
    assert case.scenario["trajectory"]["amplitude_mm"] == 1.0
    assert case.scenario["tissue"]["young_kpa"] == young_kpa(17, "-y")
    assert case.scenario["controller"] == {"kind": "elm", "model": "models/elm-00.json"}
    assert case.scenario["recording"] == {"enabled": False}
    assert case.labels == {
        "purpose": "main",
        "group": "CUR",
        "arm": "elm",
        "young": "variable",
        "noise": "off",
        "end_point": 17,
        "direction": "-y",
    }


def test_fewer_directions_are_taken_in_turn() -> None:
    assert [path.direction for path in suites.curved_paths(5, 1)] == ["+x", "-x", "+y", "-y", "+x"]
    assert len(set(suites.curved_paths(3))) == 12


@pytest.mark.slow
@pytest.mark.parametrize("scale", SCALES.values(), ids=list(SCALES))
def test_seeds_run_where_every_controller_ran(scale: Scale) -> None:
    """So that a seed's error can be compared with those of I-FEM and the references on the same paths."""

    def paths(cases: Sequence[Case]) -> set[tuple[Label, Label]]:
        return {(case.labels["end_point"], case.labels["direction"]) for case in cases}

    seeds = paths(suites.seed_cases(scale, ["default"]))
    main = [*suites.lin_cases(scale, {}), *suites.cur_cases(scale, {})]
    assert len(seeds) == scale.seed_paths
    for arm in ("ifem", "elm", "open_loop", "rigid"):
        assert seeds <= paths([case for case in main if case.labels["arm"] == arm])


def test_times_are_taken_of_every_way_in_turn_with_what_does_not_steer() -> None:
    ways = [case.labels["jacobian"] for case in suites.timing_cases(SCALES["full"], {})]
    assert len(ways) == 50
    assert ways[:5] == ways[5:10] == ["constraint", "perturbation", "elm", "open_loop", "rigid"]


def test_sensitivity_moves_one_thing_at_a_time() -> None:
    nominal = suites.scenario(
        "n", SCALES["quick"], seed=0, trajectory=suites.Path(0, "+x").trajectory(), controller={"kind": "ifem"}
    )
    default = Scenario.load(nominal).resolved()
    for variation in VARIATIONS:
        moved = Scenario.load(apply_variation(nominal, variation)).resolved()
        differing = {key for key in default if moved[key] != default[key]}
        assert len(differing) == (0 if variation.parameter == "nominal" else 1), variation.name


@pytest.mark.parametrize("name", ["paper", "paper-v2-tiny", "lin100-v1", "", "paper-v2-full"])
def test_an_unknown_suite_is_refused_with_the_known_ones(name: str) -> None:
    with pytest.raises(ScenarioError, match=r"suite = .* is none of data105-v2.*paper-v2-smoke") as caught:
        catalogue.suite(name)
    assert caught.value.problems[0].value == name


def test_a_case_that_cannot_be_names_itself() -> None:
    draft = suites.lin_cases(SCALES["smoke"], {"elm": "nowhere.json"})[1]
    with pytest.raises(ScenarioError, match=r"lin-000-elm: controller.model = 'nowhere.json'"):
        suites.resolve_cases([draft])


# ---- scales and plans


@pytest.mark.slow
def test_a_plan_is_the_same_every_time_and_another_for_another_scale() -> None:
    smoke = SCALES["smoke"]
    assert Plan(smoke).sha256 == Plan(smoke).sha256
    assert Plan(smoke).sha256 != Plan(smoke.model_copy(update={"lin": smoke.lin + 1})).sha256
    assert len({Plan(scale).sha256 for name, scale in SCALES.items() if name != "extended"}) == 3


def test_a_plan_tells_time_and_space() -> None:
    plan, cost = Plan(SCALES["smoke"]), StepCost(ifem_s=0.002, plain_s=0.001)
    one, two = plan.seconds(cost, 1), plan.seconds(cost, 2)
    assert one["experiments"] == pytest.approx(2 * two["experiments"])
    assert one["timing"] == two["timing"]  # one worker whatever the number
    assert plan.insertions == sum(len(stage.cases) for stage in plan.stages)
    noisy = plan.seconds(StepCost(ifem_s=0.002, plain_s=0.001, noise_s=0.002), 1)
    assert noisy["data set"] == pytest.approx(2 * one["data set"])
    assert one["experiments"] < noisy["experiments"] < 2 * one["experiments"]  # some of its paths are noisy
    ids = [case.id for stage in plan.stages for case in stage.cases]
    assert len(ids) == len(set(ids))
    assert 1e6 < plan.bytes < 1e9


@pytest.mark.slow
def test_the_papers_own_insertions_are_counted_apart() -> None:
    cases = [case for stage in Plan(SCALES["full"]).stages if not stage.alone for case in stage.cases]
    none = LearningCurves((), 0.0, 25, 20)
    found = paper_outcomes(Findings(tuple(Outcome(case, {}) for case in cases), (), none, {}))
    arms = Counter(outcome.case.labels["arm"] for outcome in found)
    assert arms == {"ifem": 105 + 500, "elm": 500 + 500}


def test_the_committed_report_is_of_the_scale_full() -> None:
    report = Path(__file__).parents[3] / "benchmarks" / "results" / "paper" / "report.json"
    assert json.loads(report.read_text())["provenance"]["scale"] == SCALES["full"].model_dump(mode="json")


def test_scales_are_described_and_bounded() -> None:
    assert set(SCALE_TEXT) == set(SCALES)
    assert scale_of({"name": "mine"}, Scale, field="--scale") == Scale(name="mine")
    with pytest.raises(ScenarioError) as caught:
        scale_of({"name": "mine", "lin": 101, "pace": 1}, Scale, field="--scale")
    assert {problem.field for problem in caught.value.problems} == {"lin", "pace"}


if __name__ == "__main__":
    PINNED.write_text(json.dumps(digests(), indent=1) + "\n")


# ---- the training study


@pytest.mark.parametrize(
    ("dt_s", "names"),
    [
        (
            0.01,
            [
                "hold-50-limit-50",
                "hold-100-limit-50",
                "hold-10-limit-100",
                "hold-50-limit-100",
                "hold-100-limit-100",
                "quiet",
            ],
        ),
        (0.05, ["hold-100-limit-50", "hold-50-limit-100", "hold-100-limit-100", "quiet"]),
    ],
)
def test_training_conditions_are_whole_steps_and_never_the_nominal_pair(dt_s: float, names: list[str]) -> None:
    conditions = training_conditions(dt_s)
    assert [condition.name for condition in conditions] == names
    for condition in conditions[:-1]:
        hold_s = dict(condition.changes)["noise_hold_s"]
        assert hold_s / dt_s == pytest.approx(round(hold_s / dt_s))


def test_each_condition_has_a_data_set_and_an_elm_of_its_own() -> None:
    scale = SCALES["full"]
    cases = other_training_cases(scale)
    assert len(cases) == 6 * scale.retraining
    assert {case.labels["group"] for case in cases} == {"DATA"}
    fast = next(case for case in cases if case.labels[LABEL] == "hold-50-limit-100")
    assert (fast.scenario["noise_hold_s"], fast.scenario["robot"]["max_speed_mm_s"]) == (0.05, 100.0)
    assert next(case for case in cases if case.labels[LABEL] == "quiet").scenario["noise_mm"] == 0.0
    steered = [case for case in training_study_cases(scale) if case.labels["arm"] == "elm"]
    models = {case.scenario["controller"]["model"] for case in steered}
    assert models == {condition.model for condition in training_conditions(scale.dt_s)}
    for case in training_study_cases(scale):
        faster = "limit 100" in str(case.labels["value"])
        assert case.scenario.get("robot", {}) == ({"max_speed_mm_s": 100.0} if faster else {})
        assert case.labels["arm"] == "elm" or faster
    quiet = quiet_cases(scale)
    assert {case.labels["arm"] for case in quiet} == {"elm_quiet"}
    assert {case.scenario["controller"]["model"] for case in quiet} == {"models/elm-quiet.json"}
    assert len(quiet) == 200


def test_without_retraining_there_is_no_training_study() -> None:
    scale = SCALES["smoke"].model_copy(update={"retraining": 0})
    assert not [*other_training_cases(scale), *training_study_cases(scale), *quiet_cases(scale)]
    assert "other data sets" not in {stage.title for stage in Plan(scale).stages}


def test_saturation_is_the_share_of_all_steps() -> None:
    """By hand: 100 steps at 0.9 and 300 at 0.5 are 240 of 400."""
    rows_ = rows(
        Outcome(
            Case(f"DATA-{i}", {"noise_mm": 0.25, "dt_s": 0.01, "robot": {"max_speed_mm_s": 50.0}}, {"group": "DATA"}),
            {"metrics": {"stable": True, "steps_completed": steps, "limited_fraction": share}},
        )
        for i, (steps, share) in enumerate([(100, 0.9), (300, 0.5)])
    )
    other = replace(rows_[0], labels={"group": "DATA", LABEL: "quiet"}, metrics={"stable": True, "steps_completed": 0})
    nominal, quiet = training_scores([*rows_, other])
    assert (nominal.condition, nominal.insertions, nominal.steps, nominal.hold_ms) == ("nominal", 2, 400, 10.0)
    assert nominal.saturated == pytest.approx(0.6)
    assert (quiet.condition, quiet.saturated) == ("quiet", None)
