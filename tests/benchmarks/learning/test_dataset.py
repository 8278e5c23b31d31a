"""The training insertions: where they go, in which order they are gathered, and what a model keeps of them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
import pytest

from benchmarks.cases import Case
from benchmarks.learning.training import train_model
from benchmarks.learning.training_insertions import Insertion, collect_dataset, grid_mm, training_insertions
from simcore.learning import LinearModel, NearestNeighbours, parse_model
from simcore.learning.regressor import DataError
from simcore.rollout.dataset import VARIABLES, Dataset, DatasetError

MATRIX = np.random.default_rng(0).normal(size=(6, 3))


def fake(these: Sequence[Case]) -> Iterator[Insertion]:
    """Ten linear steps each, the last case first."""
    for case in reversed(these):
        rng = np.random.default_rng(case.scenario["seed"])
        table = {name: rng.normal(size=(10, 3)) for name in VARIABLES}
        table["base_step_m"] = np.hstack([table["base_position_m"], table["tip_error_m"]]) @ MATRIX
        yield Insertion(case, table, "completed", f"digest {case.id}")


def made(insertions: int = 12) -> Dataset:
    return collect_dataset(training_insertions(insertions=insertions, seed=2), fake, samples=100, seed=2)


def test_the_grid_is_the_papers() -> None:
    grid = grid_mm()
    assert grid.shape == (105, 3)
    assert len(np.unique(grid[:, 0])) == 7
    assert len(np.unique(grid[:, 1])) == 15
    np.testing.assert_allclose(grid[0], [36 / 14, 62 / 30, 122])
    np.testing.assert_allclose(grid[-1], [36 - 36 / 14, 62 - 62 / 30, 122])
    np.testing.assert_allclose(grid[52], [18, 31, 122])
    np.testing.assert_allclose(grid[16] - grid[0], [36 / 7, 62 / 15, 0])


def test_each_insertion_is_an_ifem_run_with_noise_of_its_own() -> None:
    all_of_them = training_insertions(insertions=105, seed=3)
    assert len({case.id for case in all_of_them}) == 105
    assert sorted(case.scenario["seed"] for case in all_of_them) == list(range(3000, 3105))
    for case, end in zip(all_of_them, grid_mm(), strict=True):
        assert case.scenario["noise_mm"] == 0.25
        assert case.scenario["controller"]["kind"] == "ifem"
        assert case.scenario["trajectory"]["kind"] == "line"
        assert case.scenario["trajectory"]["entry_mm"] == [18.0, 31.0, 0.0]
        np.testing.assert_array_equal(case.scenario["trajectory"]["target_mm"], end)


def test_a_subset_is_spread_over_the_grid_and_a_change_reaches_all() -> None:
    few = training_insertions(insertions=4, seed=0, changes={"dt_s": 0.05, "trajectory": {"speed_mm_s": 20.0}})
    assert [case.labels["end_point"] for case in few] == [0, 35, 69, 104]
    assert {case.scenario["dt_s"] for case in few} == {0.05}
    assert {case.scenario["trajectory"]["speed_mm_s"] for case in few} == {20.0}
    with pytest.raises(DatasetError, match="insertions = 1: must be 2 to 105"):
        training_insertions(insertions=1, seed=0)


def test_insertions_are_gathered_in_the_order_of_the_cases() -> None:
    data, chosen = made(), training_insertions(insertions=12, seed=2)
    assert [i["id"] for i in data.provenance["insertions"]] == [case.id for case in chosen]
    assert data.provenance["insertions"][3]["digest"] == f"digest {chosen[3].id}"
    first = next(i for i in fake(chosen) if i.case.id == chosen[0].id)
    np.testing.assert_array_equal(data.variables["tip_m"][:10], first.table["tip_m"])
    np.testing.assert_allclose(1e3 * data.end_point_m[0], chosen[0].scenario["trajectory"]["target_mm"])
    assert data.provenance["commit"]
    assert data.provenance["scenario_template"]["noise_mm"] == 0.25


def test_an_insertion_that_was_not_run_is_named() -> None:
    with pytest.raises(DatasetError, match="1 insertions were not run, the first is DATA-104"):
        collect_dataset(training_insertions(insertions=3, seed=0), lambda these: fake(these[:-1]), samples=10, seed=0)


@pytest.mark.parametrize("split", ["sample", "trajectory"])
def test_training_tells_its_errors_and_where_the_model_comes_from(split: str) -> None:
    done = train_model(made(), LinearModel(ridge=0.0), split=split, data_sha256="ab")
    np.testing.assert_allclose(done.train_rmse_mm, 0.0, atol=1e-9)
    np.testing.assert_allclose(done.test_rmse_mm, 0.0, atol=1e-9)
    told = parse_model(done.model.text().encode(), "linear").provenance
    assert told["data_sha256"] == "ab"
    assert told["split"] == split
    assert told["insertions"] == 12
    assert told["train_rows"] + told["test_rows"] == 100
    assert told["trained_on"]["tissue"]["young_kpa"] == 6.3
    assert "target_mm" not in told["trained_on"]["trajectory"]


def test_the_error_is_that_of_the_held_out_rows_and_fewer_samples_are_fewer() -> None:
    done = train_model(made(), NearestNeighbours(neighbours=1), split="sample", samples=20)
    assert done.model.provenance["train_rows"] == 20
    np.testing.assert_allclose(done.train_rmse_mm, 0.0, atol=1e-9)
    assert (done.test_rmse_mm > 100.0).all()


def test_a_data_set_that_leaves_one_side_empty_is_refused() -> None:
    tiny = collect_dataset(training_insertions(insertions=2, seed=0), fake, samples=2, seed=1)
    with pytest.raises(DataError, match="the data set is too small"):
        train_model(tiny, LinearModel(), split="sample")
