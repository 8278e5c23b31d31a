"""Results in the store, as workers would have left them: tested is what a page shows, not how they came about."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from service.store.job import FAILED, FINISHED, Outcome

if TYPE_CHECKING:
    from collections.abc import Callable

    from service.api.context import Service
    from service.store.job import Job

Measured = dict[str, float]


def end_all(service: Service, measure: Callable[[dict[str, Any]], Measured | None]) -> list[Job]:
    """End every queued job. measure: metrics from a resolved scenario, None for a job that fails."""
    ended = []
    while (job := service.store.claim()) is not None:
        scenario = (job.spec or {})["scenario"]
        metrics = measure(scenario)
        if metrics is None:
            outcome = Outcome(state=FAILED, error_kind="exception", error="the step did not converge")
        else:
            outcome = Outcome(state=FINISHED, result=result_of(scenario, metrics))
        ended.append(service.store.finish(job, outcome))
    service.keeper.tick()
    return ended


def result_of(scenario: dict[str, Any], metrics: Measured) -> dict[str, Any]:
    """The result of an insertion with these metrics."""
    part = {"median_ms": metrics.get("step_ms", 2.0)}
    return {
        "status": "completed",
        "message": "",
        "metrics": {"stable": True, "success": metrics["rmse_commanded_mm"] < 2.0, "steps_completed": 200, **metrics},
        "timing": {"plant": part, "jacobian": {"median_ms": 0.2}, "command": {"median_ms": 0.1}, "loop_wall_s": 0.9},
        "solver": {"iterations_mean": 3.4, "iterations_max": 9},
        "digest": f"{abs(hash(str(sorted(metrics.items())))):064x}",
        "warnings": [],
        "provenance": {"scenario": scenario, "seed": scenario["seed"], "commit": "0" * 40, "cpu": "a processor"},
    }


def by_stiffness_and_gain(scenario: dict[str, Any]) -> Measured | None:
    """Smooth in both; the open loop is beaten, stiff tissue with a high gain fails."""
    young, controller = scenario["tissue"]["young_kpa"], scenario["controller"]
    gain = controller.get("gain", 1.0)
    if young >= 12.0 and gain >= 1.5:
        return None
    worse = {"open_loop": 6.0, "frozen": 0.8}.get(controller["kind"], 1.0)
    error = worse * (0.1 + 2.0 / young + (gain - 0.9) ** 2) * (1.0 + 0.02 * scenario["seed"])
    return {
        "rmse_commanded_mm": error,
        "max_commanded_mm": 2.2 * error,
        "final_commanded_mm": 0.7 * error,
        "rcm_max_mm": {"open_loop": 1.1, "frozen": 1.6}.get(controller["kind"], 0.9) + 0.1 * gain,
        "max_push_n": {"open_loop": 1.6, "frozen": 2.4}.get(controller["kind"], 1.4) + 0.01 * young,
        "max_lateral_n": 0.3,
        "entry_drag_mm": 0.2,
        "max_strain": 0.3,
        "max_needle_stress_mpa": 120.0,
        "step_ms": 2.0 + 0.1 * gain,
    }
