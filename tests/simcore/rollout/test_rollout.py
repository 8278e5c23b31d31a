"""The one loop: reproducible to the bit, watched without being changed, failing by name."""

from __future__ import annotations

import json
import math
import os
import subprocess
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings

from simcore.errors import Status
from simcore.metrics import MEASURED
from simcore.rollout import rollout as module
from simcore.rollout.artefacts import write
from simcore.rollout.authority import AUTHORITY
from simcore.rollout.digest import DIGESTED, LAST_TISSUE, digest
from simcore.rollout.result import FRAMES, TIMES, Rollout
from simcore.rollout.rollout import run
from simcore.scenario.scenario import Scenario
from simcore.trajectory import held_noise
from tests.budget import examples
from tests.simcore.rollout.watcher import MAY_BE_NAN, Watcher, state_of
from tests.simcore.short_run import STEPS, short
from tests.strategies import small_runs
from tests.verification import verify

if TYPE_CHECKING:
    from simcore.rollout.records import StepRecord

ROOT = Path(__file__).resolve().parents[3]


# ---- reproducible to the bit


def verify_same(text: str, digests: list[str], expected: str) -> None:
    """Every digest is the expected one."""
    different = sum(found != expected for found in digests)
    source = "definition: one scenario, one result"
    verify(
        "reproducibility", f"digests that differ: {text}", expected=0, measured=different, tolerance=0, source=source
    )


@pytest.mark.slow
def test_a_run_completes_and_succeeds(plain: Rollout) -> None:
    assert plain.status is Status.COMPLETED
    assert plain.message == ""
    assert plain.success
    assert plain.metrics["steps"] == plain.metrics["steps_completed"] == short().steps == STEPS


@pytest.mark.slow
def test_twice_is_the_same_to_the_bit(plain: Rollout) -> None:
    again = run(short())
    verify_same("a second run", [again.digest], plain.digest)
    for name, array in state_of(plain).items():
        np.testing.assert_array_equal(again.series[name], array, err_msg=name)


@pytest.mark.slow
@pytest.mark.parametrize(
    "recording", [{"enabled": False}, {"every_steps": 1}, {"every_steps": 7}, {"every_steps": 10_000}]
)
def test_recording_does_not_change_the_digest(plain: Rollout, recording: dict[str, Any]) -> None:
    other = run(short(recording=recording), Watcher())
    verify_same(f"recording {json.dumps(recording)}", [other.digest], plain.digest)
    np.testing.assert_array_equal(other.series["tissue_m"][-1], plain.series["tissue_m"][-1])


@pytest.mark.slow
def test_other_runs_in_between_do_not_matter(plain: Rollout) -> None:
    run(short(seed=99, tissue={"young_kpa": 2.0}))
    verify_same("after runs of another seed and stiffness", [run(short()).digest], plain.digest)


@pytest.mark.slow
def test_a_round_trip_through_json_does_not_matter(plain: Rollout) -> None:
    assert run(Scenario.load(json.dumps(short().resolved()))).digest == plain.digest


def test_the_name_is_not_in_the_digest(plain: Rollout) -> None:
    assert run(short(name="other")).digest == plain.digest


def test_the_clock_is_not_in_the_digest(plain: Rollout) -> None:
    ticks = iter(range(100_000))
    slow = run(short(), clock=lambda: float(next(ticks)))
    assert slow.digest == plain.digest
    assert slow.timing["plant"]["median_ms"] == 1000.0
    assert slow.timing["simulated_s"] == pytest.approx(STEPS * 0.1)


STATES = {*DIGESTED} - {LAST_TISSUE} | {"tissue_m"}  # of a series


def test_a_bit_of_any_state_changes_the_digest_and_nothing_else_does(plain: Rollout) -> None:
    for name, array in plain.series.items():
        changed = {**plain.series, name: array.copy()}
        last = changed[name].reshape(-1)
        last[-1] = not last[-1] if array.dtype == bool else last[-1] + 1
        assert (digest(changed) != plain.digest) == (name in STATES), name


def test_an_array_that_is_added_later_changes_no_digest_and_a_state_must_be_there(plain: Rollout) -> None:
    assert plain.series.keys() > STATES
    assert digest({**plain.series, "derived": np.zeros(1)}) == plain.digest
    assert digest({name: plain.series[name] for name in STATES}) == plain.digest
    for name in STATES:
        with pytest.raises(KeyError, match=name):
            digest({other: array for other, array in plain.series.items() if other != name})


def test_no_clock_reading_is_digested_and_no_name_twice() -> None:
    assert not {*DIGESTED} & {*TIMES, *FRAMES, *AUTHORITY}
    assert len(DIGESTED) == len({*DIGESTED})


PROGRAM = (
    "import json, sys; from simcore.scenario.scenario import Scenario; from simcore.rollout.rollout import run\n"
    "print(run(Scenario.load(sys.stdin.read())).digest)"
)


def digest_elsewhere(scenario: Scenario, **environment: str) -> str:
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", PROGRAM],
        input=json.dumps(scenario.resolved()),
        env={**os.environ, **environment},
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=True,
    )
    return done.stdout.strip()


@pytest.mark.slow
def test_another_process_gives_the_same_digest(plain: Rollout) -> None:
    threads = {"OMP_NUM_THREADS": "2", "OPENBLAS_NUM_THREADS": "2", "PYTHONHASHSEED": "7"}
    verify_same("another process, two threads asked for", [digest_elsewhere(short(), **threads)], plain.digest)


@pytest.mark.long  # compiles every kernel, as `test_another_processor_gives_the_same_digests` does
def test_a_cold_cache_gives_the_same_digest(plain: Rollout, tmp_path: Path) -> None:
    cold = digest_elsewhere(short(), NUMBA_CACHE_DIR=str(tmp_path))
    assert any(tmp_path.rglob("*.nbc"))
    warm = digest_elsewhere(short(), NUMBA_CACHE_DIR=str(tmp_path))
    verify_same("cold kernel cache, then warm", [cold, warm], plain.digest)


# ---- the seed


@pytest.mark.slow
def test_the_seed_changes_the_noise_and_the_digest(plain: Rollout) -> None:
    other = run(short(seed=12))
    assert other.digest != plain.digest
    np.testing.assert_array_equal(other.series["target_m"], plain.series["target_m"])
    assert not np.array_equal(other.series["target_noisy_m"], plain.series["target_noisy_m"])
    assert not np.array_equal(other.series["tip_m"], plain.series["tip_m"])


@pytest.mark.slow
def test_without_noise_the_seed_changes_nothing() -> None:
    one, two = run(short(noise_mm=0.0, seed=1)), run(short(noise_mm=0.0, seed=2**53 - 1))
    assert one.digest == two.digest
    np.testing.assert_array_equal(one.series["target_noisy_m"], one.series["target_m"])


def test_noise_is_bounded_and_only_on_what_the_controller_sees(plain: Rollout) -> None:
    """It is the held noise of the scenario's seed and amplitude, 0.25 mm, to rounding."""
    noise = plain.series["target_noisy_m"] - plain.series["target_m"]
    expected = held_noise(np.random.default_rng(11), amplitude_m=0.25e-3, hold_s=0.01, dt_s=0.1, steps=len(noise) - 1)
    np.testing.assert_allclose(noise, expected, atol=1e-16)
    assert np.abs(noise).max() > 0.2e-3


def test_noise_is_held_for_as_long_as_the_scenario_says() -> None:
    """Three steps of 0.1 s each, the first draws of the same seed."""
    series = run(short(noise_hold_s=0.3)).series
    noise = series["target_noisy_m"] - series["target_m"]
    expected = held_noise(np.random.default_rng(11), amplitude_m=0.25e-3, hold_s=0.3, dt_s=0.1, steps=len(noise) - 1)
    np.testing.assert_allclose(noise, expected, atol=1e-16)
    np.testing.assert_allclose(noise[0], noise[2], atol=1e-16)
    assert np.abs(noise[3] - noise[2]).max() > 1e-5


# ---- the result


def test_the_result_has_every_key_and_is_strict_json(plain: Rollout, tmp_path: Path) -> None:
    write(plain, tmp_path)

    def refuse(word: str) -> Any:
        raise AssertionError(f"{word} in result.json")

    result = json.loads((tmp_path / "result.json").read_text(), parse_constant=refuse)
    assert {"status", "metrics", "timing", "solver", "digest", "provenance"} <= result.keys()
    assert result["status"] == "completed"
    assert {"stable", "success", *MEASURED} <= result["metrics"].keys()
    for part in ("plant", "jacobian", "command", "recording"):
        assert result["timing"][part].keys() == {"median_ms", "p95_ms", "p99_ms", "max_ms"}
        values = [result["timing"][part][name] for name in ("median_ms", "p95_ms", "p99_ms", "max_ms")]
        assert values == sorted(values)
    assert result["timing"]["realtime_factor"] > 0.0
    assert result["solver"].keys() == {
        "iterations_mean",
        "iterations_max",
        "residual_max_n",
        "violation_max_m",
        "held_nodes",
    }
    assert result["digest"] == plain.digest
    assert len(result["digest"]) == 64
    assert {"scenario", "seed", "commit", "versions", "cpu", "threads"} <= result["provenance"].keys()
    assert Scenario.load(result["provenance"]["scenario"]) == short()
    with np.load(tmp_path / "series.npz", allow_pickle=False) as series:
        assert digest(dict(series)) == plain.digest


def test_metrics_are_those_of_the_series(plain: Rollout) -> None:
    errors = np.linalg.norm(plain.series["tip_m"][1:] - plain.series["target_m"][:-1], axis=1) * 1e3
    assert plain.metrics["rmse_commanded_mm"] == pytest.approx(math.sqrt((errors**2).mean()))
    assert plain.metrics["limited_fraction"] == pytest.approx(plain.series["limited"][1:].mean())


@pytest.mark.slow
def test_warnings_of_the_scenario_are_in_the_result(plain: Rollout) -> None:
    assert plain.result()["warnings"] == []
    assert "interaction.friction" in run(short(interaction={"friction": 0.5})).result()["warnings"][0]


@pytest.mark.slow
def test_the_loop_has_one_thread(monkeypatch: pytest.MonkeyPatch) -> None:
    from threadpoolctl import threadpool_info

    seen: list[int] = []

    class Counting(Watcher):
        def step(self, record: StepRecord) -> None:
            seen.extend(pool["num_threads"] for pool in threadpool_info() if pool["user_api"] == "blas")

    monkeypatch.setattr(module, "compile_kernels", lambda **_: None, raising=False)
    run(short(), Counting())
    assert set(seen) == {1}


# ---- any small scenario


ENDED = (Status.TARGET_LOST, Status.BUCKLED, Status.AUTHORITY_LOST, Status.SHAFT_BESIDE)  # by a step that converged


@pytest.mark.slow
@settings(max_examples=examples(50), deadline=None, suppress_health_check=list(HealthCheck))
@given(small_runs())
def test_any_small_run_ends_by_name_with_finite_rows_and_a_stable_digest(data: dict[str, Any]) -> None:
    scenario = Scenario.load(data)
    with np.errstate(over="ignore", invalid="ignore"):
        found, again = run(scenario), run(scenario)
    assert found.status in Status
    assert (found.message == "") == (found.status is Status.COMPLETED)
    done = len(found.series["t_s"]) - 1
    assert (
        done == scenario.steps if found.status is Status.COMPLETED else done < scenario.steps + (found.status in ENDED)
    )
    for name, array in found.series.items():
        assert np.isfinite(array).all() or name in MAY_BE_NAN, name
    assert found.series["min_det_f"].min() > 0.1
    if scenario.solver.mode == "converged":
        assert found.series["violation_m"].max() <= scenario.solver.violation_tolerance_mm * 1e-3
        assert found.series["residual_n"].max() <= scenario.solver.force_tolerance_n
    assert found.digest == again.digest
    json.dumps(found.result(), allow_nan=False)
