"""Regressors against numpy and by hand; model files that are whole, of the right kind, and nothing else."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from service.worker.network_trainer import train_network
from simcore.errors import ScenarioError
from simcore.file_names import names_mean, nothing
from simcore.learning import (
    ExtremeLearningMachine,
    LinearModel,
    MultilayerPerceptron,
    NearestNeighbours,
    Regressor,
    TrainedModel,
    load_model,
    model_digest,
    parse_model,
)
from simcore.learning.regressor import DataError, ridge_solution
from simcore.learning.trained import ModelFaultError
from tests.budget import examples

Vector = np.ndarray
RNG = np.random.default_rng(5)
X = RNG.normal(size=(400, 6)) * np.array([0.01, 0.02, 0.05, 1e-4, 1e-4, 1e-4]) + 0.1
Y = np.sin(X[:, :3] * 30) * 1e-3 + X[:, 3:] * (1 + 5 * X[:, 2:3])


def sigmoid(z: Vector) -> Vector:
    return 1.0 / (1.0 + np.exp(-z))


def standard(values: Vector) -> Vector:
    return (values - values.mean(axis=0)) / values.std(axis=0)


def fitted(kind: str) -> Regressor:
    made: dict[str, Regressor] = {
        "elm": ExtremeLearningMachine(seed=3),
        "linear": LinearModel(),
        "neighbours": NearestNeighbours(neighbours=4),
        "mlp": MultilayerPerceptron(hidden=(5, 4), seed=1, trainer=train_network),
    }
    return made[kind].fit(X, Y)


KINDS = ["elm", "linear", "neighbours", "mlp"]


# ---- the extreme learning machine


def test_beta_is_numpys_least_squares_solution() -> None:
    machine = ExtremeLearningMachine(nodes=25, ridge=0.0, seed=7).fit(X, Y)
    w, b = machine.arrays["w"], machine.arrays["b"]
    beta = np.linalg.lstsq(sigmoid(standard(X) @ w.T + b), standard(Y), rcond=None)[0]
    np.testing.assert_allclose(machine.arrays["beta"], beta, rtol=1e-6, atol=1e-8)
    expected = sigmoid(standard(X) @ w.T + b) @ beta * Y.std(axis=0) + Y.mean(axis=0)
    np.testing.assert_allclose(machine.predict(X), expected, rtol=1e-9)


def test_one_node_by_hand() -> None:
    """w = (1, 0), b = 0, beta = 2 on means (1, 0), scales (2, 1), outputs 3 + 10 (...): Y = 3 + 20 g((x - 1) / 2)."""
    machine = ExtremeLearningMachine(nodes=1).keep(
        {
            "input_mean": np.array([1.0, 0.0]),
            "input_scale": np.array([2.0, 1.0]),
            "output_mean": np.array([3.0]),
            "output_scale": np.array([10.0]),
            "w": np.array([[1.0, 0.0]]),
            "b": np.array([0.0]),
            "beta": np.array([[2.0]]),
        }
    )
    at = np.array([[1.0, 9.0], [1.0 + 2.0 * np.log(3.0), -4.0], [1.0 - 2.0 * np.log(3.0), 0.0]])
    np.testing.assert_allclose(machine.predict(at), [[13.0], [18.0], [8.0]], rtol=1e-14)  # g = 1/2, 3/4, 1/4


@settings(max_examples=examples(30), deadline=None)
@given(st.integers(0, 2**32 - 1), st.floats(1e-6, 10.0))
def test_the_ridge_is_that_of_the_normal_equations(seed: int, ridge: float) -> None:
    rng = np.random.default_rng(seed)
    H, y = rng.normal(size=(30, 6)), rng.normal(size=(30, 3))
    expected = np.linalg.solve(H.T @ H + 30 * ridge * np.eye(6), H.T @ y)
    np.testing.assert_allclose(ridge_solution(H, y, ridge), expected, rtol=1e-7, atol=1e-9)


def test_the_seed_makes_the_weights_and_only_they_are_random() -> None:
    one, same, other = (ExtremeLearningMachine(seed=seed).fit(X, Y) for seed in (1, 1, 2))
    for name in one.arrays:
        np.testing.assert_array_equal(one.arrays[name], same.arrays[name])
    assert not np.array_equal(one.arrays["w"], other.arrays["w"])
    assert np.abs(one.arrays["w"]).max() <= 1.0


@pytest.mark.slow
@pytest.mark.parametrize("name", ["w", "b"])
def test_weights_and_biases_are_uniform_in_their_range(name: str) -> None:
    drawn = ExtremeLearningMachine(nodes=800, weight_range=0.7, seed=3).fit(X, Y).arrays[name]
    assert 0.69 < np.abs(drawn).max() <= 0.7
    assert abs(drawn.mean()) < 5 * 0.7 / np.sqrt(3 * drawn.size)
    np.testing.assert_allclose(drawn.std(), 0.7 / np.sqrt(3), rtol=0.05)


def test_the_default_ridge_has_no_visible_bias() -> None:
    plain, default = (
        machine.fit(X, Y).predict(X) for machine in (ExtremeLearningMachine(ridge=0.0), ExtremeLearningMachine())
    )
    assert np.abs(default - plain).max() < 1e-3 * Y.std()


def test_more_nodes_fit_closer_and_the_default_is_the_papers() -> None:
    def rmse(nodes: int) -> float:
        return float(np.sqrt(np.mean((ExtremeLearningMachine(nodes=nodes).fit(X, Y).predict(X) - Y) ** 2)))

    assert rmse(100) < rmse(25) < rmse(3)
    assert ExtremeLearningMachine().nodes == 25


@pytest.mark.slow
def test_a_column_that_does_not_change_is_harmless() -> None:
    still = X.copy()
    still[:, 1] = 0.031
    for kind in KINDS:
        assert np.isfinite(fitted(kind).fit(still, Y).predict(still)).all()


# ---- the baselines


def test_linear_regression_finds_a_linear_law() -> None:
    a = RNG.normal(size=(6, 3))
    law = X @ a + np.array([1.0, -2.0, 3.0])
    np.testing.assert_allclose(
        LinearModel(ridge=0.0).fit(X, law).predict(X[:7] + 1.0), law[:7] + a.sum(axis=0), atol=1e-9
    )


def test_the_nearest_neighbour_of_a_sample_is_itself() -> None:
    np.testing.assert_allclose(NearestNeighbours(neighbours=1).fit(X, Y).predict(X), Y, atol=1e-15)


def test_neighbours_are_averaged_in_standardised_inputs() -> None:
    near = standard(X)
    distances = np.linalg.norm(near - near[17] - 0.01, axis=1)
    expected = Y[np.argsort(distances)[:4]].mean(axis=0)
    at = X[17] + 0.01 * X.std(axis=0)
    np.testing.assert_allclose(fitted("neighbours").predict(at[None])[0], expected, atol=1e-12)


@pytest.mark.slow
def test_the_network_is_scikit_learns_without_scikit_learn() -> None:
    neural_network = pytest.importorskip("sklearn.neural_network")
    theirs: list[Any] = []

    def trainer(x: Vector, y: Vector, hidden: tuple[int, ...], seed: int) -> list[tuple[Vector, Vector]]:
        network = neural_network.MLPRegressor(
            hidden_layer_sizes=hidden, activation="tanh", solver="lbfgs", max_iter=20_000, random_state=seed
        )
        theirs.append(network.fit(x, y))
        return list(zip(network.coefs_, network.intercepts_, strict=True))

    mine = MultilayerPerceptron(hidden=(5, 4), trainer=trainer).fit(X, Y)
    np.testing.assert_allclose(mine.predict(X), theirs[0].predict(standard(X)) * Y.std(axis=0) + Y.mean(axis=0))


# ---- what cannot be learned from


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_data_that_does_not_fit_is_refused(kind: str) -> None:
    regressor = fitted(kind)
    bad = X.copy()
    bad[[12, 30], 2] = np.nan
    with pytest.raises(DataError, match="2 of 400 rows that are not finite, the first is row 12"):
        regressor.fit(bad, Y)
    with pytest.raises(DataError, match="X has 400 rows, Y has 399"):
        regressor.fit(X, Y[1:])
    with pytest.raises(DataError, match=r"shape \(400, 5\).*takes \(n, 6\)"):
        regressor.predict(X[:, :5])


def test_an_untrained_model_and_impossible_settings_are_refused() -> None:
    with pytest.raises(DataError, match="call fit first"):
        LinearModel().predict(X)
    with pytest.raises(DataError, match="nodes = 0: must be 1 to 10000"):
        ExtremeLearningMachine(nodes=0)
    with pytest.raises(DataError, match="hidden"):
        MultilayerPerceptron(hidden=())
    with pytest.raises(DataError, match="needs a trainer"):
        MultilayerPerceptron().fit(X, Y)


# ---- files


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_a_model_comes_back_as_it_was_written(kind: str) -> None:
    model = TrainedModel(fitted(kind), {"data_sha256": "abc"})
    again = parse_model(model.text().encode(), kind)
    np.testing.assert_array_equal(again.regressor.predict(X), model.regressor.predict(X))
    assert again.provenance == {"data_sha256": "abc"}
    assert again.text() == model.text()


def spoiled(change: Any) -> bytes:
    content = json.loads(TrainedModel(fitted("elm"), {}).text())
    change(content)
    return json.dumps(content).encode()


FAULTS = {
    "another format": (lambda c: c.update(format="other"), "is not a model: its format is 'other'"),
    "another version": (lambda c: c.update(version=2), "version 2; this program reads version 1"),
    "another kind": (lambda c: c.update(kind="linear"), "of kind 'linear', not 'elm'"),
    "another width": (lambda c: c.update(inputs=7), "has 7 inputs and 3 outputs; a controller needs 6 and 3"),
    "other settings": (lambda c: c["settings"].update(nodes=0), "nodes = 0: must be 1 to 10000"),
    "unknown settings": (lambda c: c["settings"].update(depth=3), "has settings that cannot be"),
    "no provenance": (lambda c: c.pop("provenance"), "has no provenance"),
    "an array less": (lambda c: c["arrays"].pop("beta"), "exactly the arrays"),
    "another shape": (lambda c: c["arrays"]["w"].pop(), r"array w has the shape \(24, 6\), not \(25, 6\)"),
    "text": (lambda c: c["arrays"].update(b=["x"] * 25), "array b is not made of numbers"),
    "infinite": (lambda c: c["arrays"]["b"].__setitem__(3, float("inf")), "array b holds values that are not finite"),
    "a zero scale": (lambda c: c["arrays"]["input_scale"].__setitem__(0, 0.0), "scale that is not above 0"),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_each_fault_of_a_file_is_one_clear_message(fault: str) -> None:
    change, message = FAULTS[fault]
    with pytest.raises(ModelFaultError, match=message):
        parse_model(spoiled(change), "elm")


@pytest.mark.parametrize("data", [b"", b"PK\x03\x04", b"[1, 2]", b"[" * 100_000, b"\xff\xfe"])
def test_what_is_no_model_at_all_is_refused(data: bytes) -> None:
    with pytest.raises(ModelFaultError, match="JSON"):
        parse_model(data, "elm")


# ---- by the name that a scenario gives


def test_a_file_is_known_by_its_digest(tmp_path: Path) -> None:
    path = tmp_path / "mine.json"
    path.write_text(TrainedModel(fitted("linear"), {"n": 1}).text())
    digest = model_digest("linear", str(path), None)
    path.write_text(TrainedModel(fitted("linear"), {"n": 2}).text())
    with pytest.raises(ScenarioError, match="has changed: its SHA-256 is"):
        model_digest("linear", str(path), digest)
    path.unlink()
    assert load_model("linear", str(path), digest).provenance == {"n": 1}


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda path: None, "cannot be read: No such file"),
        (lambda path: path.mkdir(), "is not a file"),
        (lambda path: path.write_text("{}"), "is not a model"),
    ],
)
def test_a_file_that_cannot_be_used_is_a_problem_of_the_field(tmp_path: Path, make: Any, message: str) -> None:
    path = tmp_path / "mine.json"
    make(path)
    with pytest.raises(ScenarioError, match=message) as caught:
        model_digest("elm", str(path), None)
    assert caught.value.problems[0].field == "controller.model"


def test_a_large_file_is_not_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "large.json"
    with path.open("wb") as file:
        file.truncate(50_000_001)
    monkeypatch.setattr(Path, "read_bytes", None)
    with pytest.raises(ScenarioError, match="holds 50 MB, at most 50"):
        model_digest("elm", str(path), None)


def test_where_files_may_not_be_named_only_the_packaged_model_is_there() -> None:
    with names_mean(nothing), pytest.raises(ScenarioError, match="not accepted here"):
        model_digest("elm", "/etc/passwd", None)


def test_a_kind_without_a_packaged_model_says_how_to_make_one() -> None:
    with pytest.raises(ScenarioError, match="no model of kind neighbours comes along; make one: needlebench train"):
        model_digest("neighbours", "default", None)
