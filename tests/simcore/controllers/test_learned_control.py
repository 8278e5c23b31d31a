"""Controllers that learn, that stay rigid, that freeze their Jacobian, and those of other packages, on toy plants."""

from __future__ import annotations

import json
from importlib.metadata import EntryPoint
from typing import TYPE_CHECKING, Any, get_args

import numpy as np
import pytest

from simcore import plugins
from simcore.controllers import Observation, make_controller
from simcore.controllers.frozen_jacobian import FrozenJacobianController, straight_jacobian
from simcore.controllers.learned import LearnedController
from simcore.controllers.registry import FACTORIES
from simcore.controllers.remote_centre import pose_through
from simcore.controllers.selective_inverse import selective_move
from simcore.errors import ModelFailureError, ScenarioError, Status
from simcore.insertion.insertion import rotation_towards
from simcore.insertion.state import Pose
from simcore.learning import LinearModel, TrainedModel
from simcore.plugins import PluginError
from simcore.rollout.rollout import run
from simcore.rotations import exp_map
from simcore.scenario.controller_blocks import KINDS, Controller
from simcore.scenario.scenario import FrozenJacobian, Scenario
from tests.simcore.block import block_scenario

if TYPE_CHECKING:
    from pathlib import Path

Vector = np.ndarray
ENTRY = np.array([0.018, 0.031, 0.0])
LENGTH_M = 0.18
START = Pose(np.array([0.018, 0.031, -0.18]), np.eye(3))


def scenario(controller: dict[str, Any], **fields: Any) -> Scenario:
    return Scenario.load({"controller": controller, **fields})


def controller_of(data: dict[str, Any], **fields: Any) -> Any:
    return make_controller(scenario(data, **fields), entry_m=ENTRY, needle_length_m=LENGTH_M, model=None)


def tip_of(base: Pose) -> Vector:
    return base.position_m + LENGTH_M * base.rotation[:, 2]


def seen(target_m: Vector, base: Pose = START, tip_m: Vector | None = None, step: int = 0) -> Observation:
    return Observation(step, base, tip_of(base) if tip_m is None else tip_m, target_m)


def linear_model(tmp_path: Path, matrix: Vector, provenance: dict[str, Any] | None = None) -> str:
    """A file with Delta P = (P, e_p) @ matrix."""
    rng = np.random.default_rng(1)
    X = rng.normal(size=(50, 6)) + 0.1
    model = TrainedModel(LinearModel(ridge=0.0).fit(X, X @ matrix), provenance or {})
    path = tmp_path / "linear.json"
    path.write_text(model.text())
    return str(path)


# ---- kinds


def test_every_kind_of_block_has_one_factory_and_is_named_in_the_descriptions() -> None:
    kinds = [block.model_fields["kind"].default for block in get_args(get_args(Controller)[0])]
    assert sorted(kinds) == sorted(FACTORIES)
    assert sorted(kinds) == sorted(KINDS.replace(" or ", ", ").split(", "))
    for block in get_args(get_args(Controller)[0]):
        assert block.model_fields["kind"].description == KINDS


# ---- the rule of the remote centre


@pytest.mark.parametrize("seed", range(5))
def test_the_axis_passes_through_the_entry_without_a_twist(seed: int) -> None:
    rng = np.random.default_rng(seed)
    before = exp_map(rng.normal(size=3) * 0.3)
    position = ENTRY + np.array([*rng.normal(size=2) * 0.02, -0.1])
    pose = pose_through(ENTRY, position, before)
    np.testing.assert_allclose(pose.position_m, position)
    reach = np.linalg.norm(ENTRY - position)
    np.testing.assert_allclose(position + reach * pose.rotation[:, 2], ENTRY, atol=1e-12)
    turn = pose.rotation @ before.T
    spin = np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]])
    assert abs(spin @ before[:, 2]) < 1e-12


def test_at_the_entry_itself_and_on_the_axis_the_rotation_stays() -> None:
    turned = exp_map(np.array([0.1, 0.2, 0.0]))
    np.testing.assert_array_equal(pose_through(ENTRY, ENTRY + 1e-4, turned).rotation, turned)
    on_axis = ENTRY - 0.1 * turned[:, 2]
    np.testing.assert_allclose(pose_through(ENTRY, on_axis, turned).rotation, turned, atol=1e-12)


# ---- learned


def test_a_learned_controller_moves_by_the_prediction_of_position_and_error(tmp_path: Path) -> None:
    matrix = np.random.default_rng(2).normal(size=(6, 3))
    model = linear_model(tmp_path, matrix)
    controller = controller_of({"kind": "linear", "model": model})
    assert isinstance(controller, LearnedController)
    target = ENTRY + np.array([1e-3, -2e-3, 3e-3])
    pose = controller.command(seen(target))
    expected = START.position_m + np.concatenate([START.position_m, target - tip_of(START)]) @ matrix
    np.testing.assert_allclose(pose.position_m, expected, atol=1e-10)
    assert controller.limited


def test_the_digest_of_the_model_is_part_of_the_scenario(tmp_path: Path) -> None:
    block = {"kind": "linear", "model": linear_model(tmp_path, np.ones((6, 3)))}
    loaded = scenario(block)
    digest = loaded.resolved()["controller"]["model_sha256"]
    assert len(digest) == 64
    assert Scenario.load(loaded.resolved()) == loaded
    linear_model(tmp_path, np.zeros((6, 3)))
    with pytest.raises(ScenarioError, match="has changed"):
        Scenario.load(loaded.resolved())
    assert scenario(block).resolved()["controller"]["model_sha256"] != digest


def test_a_model_of_another_kind_is_a_problem_of_the_field(tmp_path: Path) -> None:
    with pytest.raises(ScenarioError, match=r"controller\.model.*of kind 'linear', not 'elm'"):
        scenario({"kind": "elm", "model": linear_model(tmp_path, np.ones((6, 3)))})


def test_running_elsewhere_than_trained_is_a_warning_for_each_field(tmp_path: Path) -> None:
    default = Scenario.load({}).resolved()
    trained = {name: default[name] for name in ("dt_s", "tissue", "needle", "interaction", "trajectory", "motion")}
    trained["path_box_mm"] = [[0, 0, 0], [20, 62, 122]]
    model = linear_model(tmp_path, np.ones((6, 3)), {"trained_on": trained})
    block = {"kind": "linear", "model": model}
    assert scenario(block).warnings() == []
    other = scenario(
        block,
        dt_s=0.005,
        tissue={"young_kpa": 5.5},
        needle={"elements": 10},
        trajectory={"target_mm": [25, 31, 100], "speed_mm_s": 5},
        motion={"kind": "breathing"},
    )
    told = " ".join(other.warnings())
    fields = ("dt_s = 0.005", "young_kpa = 5.5", "elements = 10", "target_mm", "speed_mm_s = 5", "motion = breathing")
    assert len(other.warnings()) == len(fields)
    assert all(field in told for field in fields)
    assert "trained at 0.01" in told


def test_a_model_that_tells_nothing_of_its_training_is_a_warning(tmp_path: Path) -> None:
    (told,) = scenario({"kind": "linear", "model": linear_model(tmp_path, np.ones((6, 3)))}).warnings()
    assert "does not say what it was trained on" in told


# ---- rigid


@pytest.mark.parametrize("target", [[0.02, 0.03, 0.05], [0.005, 0.055, 0.122], [0.018, 0.031, 0.1]])
def test_a_rigid_needle_is_put_with_its_tip_at_the_target_and_through_the_entry(target: list[float]) -> None:
    pose = controller_of({"kind": "rigid"}).command(seen(np.array(target), tip_m=np.full(3, 9.0)))
    np.testing.assert_allclose(tip_of(pose), target, atol=1e-12)
    reach = (ENTRY - pose.position_m) @ pose.rotation[:, 2]
    np.testing.assert_allclose(pose.position_m + reach * pose.rotation[:, 2], ENTRY, atol=1e-12)


def test_near_the_entry_a_rigid_needle_keeps_its_direction_under_noise() -> None:
    oblique = {"kind": "line", "target_mm": [24, 41, 122]}
    controller = controller_of({"kind": "rigid"}, trajectory=oblique)
    tangent = scenario({"kind": "rigid"}, trajectory=oblique).path().first_tangent()
    for depth, noise in ((0.0, 0.0), (1e-3, 2.5e-4), (9e-3, -2.5e-4)):
        pose = controller.command(seen(ENTRY + depth * tangent + noise * np.array([1.0, -1.0, 0.5])))
        np.testing.assert_allclose(pose.rotation[:, 2], tangent, atol=1e-12)


# ---- frozen


@pytest.fixture(scope="module")
def coarse() -> Scenario:
    model = {"element_size_mm": 10.0, "spacing_mm": 10.0}
    return block_scenario(controller={"kind": "frozen", "depth_mm": 15.0, "model": model})


def test_the_frozen_jacobian_is_that_of_a_straight_insertion(coarse: Scenario) -> None:
    """Axially the tip follows the base; sideways it moves the other way, as the needle swings about the entry: a rigid
    one by -depth / reach, one in tissue by less. In a symmetric block x and y do not mix."""
    block = coarse.controller
    assert isinstance(block, FrozenJacobian)
    jacobian = straight_jacobian(block, coarse)
    assert jacobian[2, 2] == pytest.approx(1.0, abs=1e-3)
    assert np.abs(jacobian[:2, 2]).max() < 1e-3
    rigid = -15.0 / (90.0 - 15.0)
    for axis in (0, 1):
        assert rigid < jacobian[axis, axis] < 0.1 * rigid
    assert abs(jacobian[0, 1]) + abs(jacobian[1, 0]) < 0.05 * abs(jacobian[0, 0])


def test_the_frozen_controller_inverts_one_constant_jacobian(coarse: Scenario) -> None:
    block = coarse.controller
    assert isinstance(block, FrozenJacobian)
    entry = np.array([0.012, 0.020, 0.0])
    controller = FrozenJacobianController(block, coarse, entry)
    jacobian, largest_m = straight_jacobian(block, coarse), 0.3 * coarse.dt_s
    for step, sideways in enumerate((1e-3, -2e-3)):
        base = Pose(entry + np.array([sideways, 2e-3, -0.07]), exp_map(np.array([0.01, -0.02, 0.0])))
        error = np.array([1e-4, -2e-4, 3e-4])
        pose = controller.command(Observation(step, base, np.zeros(3), error))
        np.testing.assert_allclose(
            pose.position_m, base.position_m + selective_move(jacobian, error, largest_m), atol=1e-12
        )
        reach = np.linalg.norm(entry - pose.position_m)
        np.testing.assert_allclose(pose.position_m + reach * pose.rotation[:, 2], entry, atol=1e-12)


def test_an_insertion_that_fails_is_told_by_the_first_command(coarse: Scenario) -> None:
    data = coarse.resolved()
    data["solver"]["max_iterations"] = 1
    hopeless = Scenario.load(data)
    block = hopeless.controller
    assert isinstance(block, FrozenJacobian)
    controller = FrozenJacobianController(block, hopeless, np.array([0.012, 0.020, 0.0]))
    with pytest.raises(ModelFailureError, match="insertion for the frozen Jacobian") as caught:
        controller.command(seen(ENTRY))
    assert caught.value.status is Status.NOT_CONVERGED


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["rigid", "frozen"])
def test_the_baselines_run_in_the_loop(kind: str) -> None:
    path = {"kind": "line", "target_mm": [14.0, 22.0, 12.0], "speed_mm_s": 20.0}
    fields: dict[str, Any] = {"depth_mm": 8.0} if kind == "frozen" else {}
    done = run(block_scenario(controller={"kind": kind, **fields}, trajectory=path))
    assert done.status is Status.COMPLETED, done.message
    assert done.metrics["rmse_commanded_mm"] < 1.0


# ---- plug-ins


class Straight:
    """Advances along the axis by the share that its settings say."""

    limited = False

    def __init__(self, asked: Scenario, entry_m: Vector, needle_length_m: float, settings: dict[str, Any]) -> None:
        assert isinstance(asked, Scenario)
        assert needle_length_m == LENGTH_M
        self.share = settings.get("share", 1.0)

    def command(self, observation: Observation) -> Pose:
        base = observation.base
        return Pose(base.position_m + self.share * 1e-4 * base.rotation[:, 2], base.rotation)


@pytest.fixture
def registered(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(plugins, "_registered", {})
    plugins.register_controller("straight", Straight)


@pytest.mark.usefixtures("registered")
def test_a_registered_controller_is_run_with_its_settings() -> None:
    controller = controller_of({"kind": "plugin", "name": "straight", "settings": {"share": 0.5}})
    np.testing.assert_allclose(controller.command(seen(ENTRY)).position_m, [0.018, 0.031, -0.17995])
    assert controller.limited is False


@pytest.mark.usefixtures("registered")
def test_an_unknown_plug_in_lists_those_that_are_installed() -> None:
    with pytest.raises(ScenarioError, match=r"controller\.name = 'other'.*installed: mpc, straight"):
        scenario({"kind": "plugin", "name": "other"})


def test_without_any_the_message_leads_to_the_example(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(plugins, "_registered", {})
    monkeypatch.setattr(plugins, "entry_points", lambda group: [])
    with pytest.raises(ScenarioError, match="needlebench example controller"):
        scenario({"kind": "plugin", "name": "other"})


def test_installed_packages_are_found_by_their_entry_points(monkeypatch: pytest.MonkeyPatch) -> None:
    points = [
        EntryPoint("theirs", f"{__name__}:Straight", plugins.GROUP),
        EntryPoint("broken", "no_such_package:make", plugins.GROUP),
    ]
    monkeypatch.setattr(plugins, "entry_points", lambda group: points if group == plugins.GROUP else [])
    assert {"broken", "theirs"} <= set(plugins.installed())
    assert controller_of({"kind": "plugin", "name": "theirs"}).command(seen(ENTRY)).position_m[2] > -0.18
    with pytest.raises(ScenarioError, match=r"'broken'.*cannot find its module no_such_package"):
        controller_of({"kind": "plugin", "name": "broken"})


def test_a_factory_that_makes_no_controller_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(plugins, "_registered", {"odd": lambda *_: 3})
    with pytest.raises(PluginError, match=r"'odd': its factory returned int, no Controller"):
        controller_of({"kind": "plugin", "name": "odd"})


@pytest.mark.usefixtures("registered")
@pytest.mark.parametrize("settings", ['{"a": NaN}', '{"a": 1e999}', json.dumps({"a": "x" * 100_000}), "[1]"])
def test_settings_are_finite_short_json(settings: str) -> None:
    text = f'{{"controller": {{"kind": "plugin", "name": "straight", "settings": {settings}}}}}'
    with pytest.raises(ScenarioError, match=r"controller\.settings"):
        Scenario.load(text)


def test_a_straight_needle_faces_its_path() -> None:
    """The helper of plug-ins: rotation_towards takes +z to a direction."""
    direction = np.array([0.6, 0.0, 0.8])
    np.testing.assert_allclose(rotation_towards(direction)[:, 2], direction, atol=1e-15)
