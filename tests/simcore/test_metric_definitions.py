"""The registry of metrics and the results that runs give name the same things."""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

from simcore.errors import STATUSES, Status
from simcore.metric_definitions import METRICS, SERIES, UNIT_OF_SUFFIX, UNITS
from simcore.rollout.rollout import run
from tests.simcore.short_run import LINE, replay, short

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from simcore.rollout.result import Rollout

GOLDEN = Path(__file__).parents[2] / "benchmarks" / "results" / "builtin_scenarios.json"
BLOCKS = ("metrics", "timing", "solver")
AWAY = [[12.0, 20.0, -80.0 + 0.1 * step, 1.0, 0.0, 0.0, 0.0] for step in range(1, 4)]
TURNED = [[12.0, 20.0, -80.0, 0.0, 1.0, 0.0, 0.0]]  # upside down within one step: nothing converges


@cache
def rollout(kind: str) -> Rollout:
    """One short run of each kind whose result could have other keys."""
    changes: dict[str, dict[str, Any]] = {
        "steered": {},
        "open loop": {"controller": {"kind": "open_loop"}, "trajectory": LINE},
        "never punctured": {"controller": replay(AWAY[:1]), "noise_mm": 0.0, "interaction": {"puncture_n": 0.1}},
        "failed in its first step": {"controller": replay(TURNED)},
    }
    return run(short(**changes[kind]))


KINDS = ("steered", "open loop", "never punctured", "failed in its first step")


def leaves(block: Mapping[str, Any], prefix: str) -> Iterator[str]:
    """Dotted paths of the values in nested blocks."""
    for name, value in block.items():
        path = f"{prefix}.{name}"
        if isinstance(value, dict):
            yield from leaves(value, path)
        else:
            yield path


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_every_number_of_a_result_is_described_and_nothing_else(kind: str) -> None:
    result = rollout(kind).result()
    found = [path for block in BLOCKS for path in leaves(result[block], block)]
    assert sorted(found) == sorted(metric.key for metric in METRICS)


def test_the_failed_run_is_one() -> None:
    """Otherwise the case above would prove less than it says."""
    failed = rollout("failed in its first step")
    assert failed.status is Status.NOT_CONVERGED
    assert failed.metrics["steps_completed"] == 0


@pytest.mark.parametrize("kind", KINDS)
def test_every_array_of_the_series_is_described_with_its_shape(kind: str) -> None:
    series = rollout(kind).series
    assert sorted(series) == sorted(array.name for array in SERIES)
    sizes = {
        "rows": len(series["t_s"]),
        "nodes": len(series["tissue_rest_m"]),
        "tetrahedra": len(series["tissue_tets"]),
        "frames": len(series["tissue_frame_step"]),
        "points": series["shaft_m"].shape[1],
        "contacts": series["contact_points_m"].shape[1],
    }
    for array in SERIES:
        shape = tuple(sizes[size] if size in sizes else int(size) for size in array.shape)
        assert series[array.name].shape == shape, array.name
        assert (series[array.name].dtype.kind == "b") == (array.unit == "yes or no"), array.name


def test_units_are_those_of_the_names() -> None:
    for name, unit in [*((metric.key, metric.unit) for metric in METRICS), *((a.name, a.unit) for a in SERIES)]:
        assert unit in UNITS, name
        suffix = f"_{name.rpartition('_')[2]}"
        if suffix in UNIT_OF_SUFFIX:
            assert unit == UNIT_OF_SUFFIX[suffix], name


def test_ranges_are_ranges_and_say_what_lies_outside() -> None:
    for metric in METRICS:
        assert metric.high is None or metric.low <= metric.high, metric.key
        assert metric.outside or metric.high is None, metric.key


def test_a_range_is_shown_as_text() -> None:
    shown = {metric.key: metric.sane_range for metric in METRICS}
    assert shown["metrics.rmse_commanded_mm"] == "0 to 1"
    assert shown["metrics.stable"] == "1"
    assert shown["metrics.steps"] == "at least 1"


@pytest.mark.parametrize("name", ["line", "sine", "demo"])
def test_built_in_scenarios_lie_in_the_sane_ranges(name: str) -> None:
    """As they were measured on the committed golden numbers; an open loop along `demo` does not."""
    golden = json.loads(GOLDEN.read_text())["cases"]

    def outside(case: str) -> list[str]:
        return [
            metric.key
            for metric in METRICS
            if (value := golden[case]["metrics"].get(metric.key.removeprefix("metrics."))) is not None
            and not metric.low <= value <= (float("inf") if metric.high is None else metric.high)
        ]

    assert outside(name) == []
    assert "metrics.rmse_commanded_mm" in outside("demo, open loop")


def test_every_status_is_described() -> None:
    assert set(STATUSES) == set(Status)
