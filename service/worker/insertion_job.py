"""What a worker process does with an insertion of which only series, or only a recording, is kept."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from service.worker.specs import InsertionSpec

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import NDArray

SERIES_RUNNER = "service.worker.insertion_job:keep_series"
RECORDING_RUNNER = "service.worker.insertion_job:keep_recording"
STATE = (
    "tip_m",
    "target_m",
    "base_position_m",
    "base_rotation",
    "limited",
    "depth_m",
    "insertion_force_n",
    "rcm_error_m",
)


def keep_series(spec: dict[str, Any], folder: Path) -> dict[str, Any]:
    """Run the insertion, keep its series without tissue as `<job_id>.npz`; the JSON of its result.

    spec: of an InsertionSpec. Without its `full_series` the state is kept in single precision: what errors, forces and
    paths are drawn from.
    """
    import numpy as np

    from simcore.rollout import rollout
    from simcore.rollout.artefacts import replace_atomically
    from simcore.scenario.scenario import Scenario

    job = InsertionSpec.from_json(spec)
    with job.file_names():
        done = rollout.run(Scenario.load(job.scenario))
        result = done.result()
    if job.full_series:
        kept = {name: array for name, array in done.series.items() if not name.startswith("tissue_")}
    else:
        kept = {name: _single(done.series[name]) for name in STATE}
    replace_atomically(folder / f"{job.job_id}.npz", lambda file: np.savez_compressed(file, allow_pickle=False, **kept))
    return result


def keep_recording(spec: dict[str, Any], folder: Path) -> dict[str, Any]:
    """Run the insertion again with its recording on, into `<job_id>.rrd`; the JSON of its result.

    Its `recording_warning` says why the recording is missing or incomplete, else it is None.
    """
    from service.recording.observer import RerunObserver
    from simcore.rollout import rollout
    from simcore.scenario.scenario import Scenario

    job = InsertionSpec.from_json(spec)
    shown = {**job.scenario, "recording": {**job.scenario["recording"], "enabled": True}}
    recorder = RerunObserver(folder / f"{job.job_id}.rrd", recording_id=job.job_id)
    with job.file_names(), recorder:
        result = rollout.run(Scenario.load(shown), recorder).result()
    return {**result, "recording_warning": recorder.warning}


def _single(array: NDArray[Any]) -> NDArray[Any]:
    return array.astype("f4") if array.dtype.kind == "f" else array


def warm_up() -> None:
    """Compile the kernels that nearly every insertion needs, or load them from the cache."""
    from simcore.rollout.rollout import compile_kernels

    compile_kernels(exact=False, linearised=False)
