"""What a worker process does with a job that trains a model. Knows no database and no HTTP."""

from __future__ import annotations

import hashlib
import json
import logging
import time
from typing import TYPE_CHECKING, Any

from service.files.replace_text import replace_text
from service.logs import ROOT
from service.worker.progress import NAME
from service.worker.specs import TrainingSpec

if TYPE_CHECKING:
    from pathlib import Path

    from simcore.learning import Regressor

RUNNER = "service.worker.training_job:train_job"
MODEL = "model.json"
STAGES = ("read the data set", "fit the model", "write the model")
SETTINGS: dict[str, tuple[str, ...]] = {  # of each kind, as its regressor calls them
    "elm": ("nodes", "ridge", "weight_range", "seed"),
    "linear": ("ridge",),
    "neighbours": ("neighbours",),
    "mlp": ("hidden", "seed"),
}
_log = logging.getLogger(ROOT)


def train_job(spec: dict[str, Any], artefact_dir: Path) -> dict[str, Any]:
    """Train a model; write model.json and result.json into the folder. Returns the JSON of result.json.

    spec: of a TrainingSpec. The same request gives the same model, to the last bit: an attempt after a death makes what
    the one before would have made.
    Raises DatasetError, DataError.
    """
    from threadpoolctl import threadpool_limits

    from benchmarks.learning.training import train_model
    from service.files.upload_names import UploadLookup
    from simcore.rollout.artefacts import replace_atomically
    from simcore.rollout.dataset import load_dataset

    job = TrainingSpec.from_json(spec)
    training = job.training
    source = UploadLookup(job.files)(training["data"])
    _log.info("job %s: %s from %s", job.job_id, training["kind"], training["data"])
    _report_progress(artefact_dir, 0)
    with source.open("rb") as file:
        sha256 = hashlib.file_digest(file, "sha256").hexdigest()
    data = load_dataset(source)
    _report_progress(artefact_dir, 1)
    begun = time.perf_counter()
    with threadpool_limits(1):
        done = train_model(
            data,
            new_regressor(training["kind"], training["settings"]),
            split=training["split"],
            samples=training["samples"],
            data_sha256=sha256,
        )
    fit_s = time.perf_counter() - begun
    _report_progress(artefact_dir, 2)
    text = done.model.text().encode()
    replace_atomically(artefact_dir / MODEL, lambda file: file.write(text))
    result = _result(artefact_dir / MODEL, text, fit_s)
    written = (json.dumps(result, indent=2, allow_nan=False) + "\n").encode()
    replace_atomically(artefact_dir / "result.json", lambda file: file.write(written))
    _report_progress(artefact_dir, 3)
    return result


def new_regressor(kind: str, settings: dict[str, Any]) -> Regressor:
    """A regressor that can be fitted. Raises DataError for settings out of their range."""
    from service.worker.network_trainer import train_network
    from simcore.learning.trained import REGRESSORS

    return REGRESSORS[kind](**settings, **({"trainer": train_network} if kind == "mlp" else {}))


def _result(model: Path, text: bytes, fit_s: float) -> dict[str, Any]:
    """In the shape of an insertion's result. Raises NotLearnedError for a model too long to be read."""
    from service.files.model_content import model_content
    from simcore.provenance import machine

    content = model_content(model)
    origin = content["provenance"]
    sha256 = hashlib.sha256(text).hexdigest()
    model_id = f"{sha256}.json"
    metrics = {name: origin[name] for name in ("train_rmse_mm", "test_rmse_mm", "train_rows", "test_rows")}
    _log.info("model of %d bytes, SHA-256 %s, test RMSE %s mm", len(text), sha256, metrics["test_rmse_mm"])
    return {
        "status": "completed",
        "message": "",
        "metrics": {"model": model_id, **metrics},
        "timing": {"fit_s": fit_s},
        "model": {"id": model_id, "bytes": len(text), **content},
        "digest": sha256,
        "warnings": [],
        "provenance": machine(),
    }


def _report_progress(folder: Path, step: int) -> None:
    fraction = round(step / len(STAGES), 4)
    replace_text(folder / NAME, json.dumps({"fraction": fraction, "step": step, "steps": len(STAGES)}))
    if step < len(STAGES):
        _log.info("%s", STAGES[step])
