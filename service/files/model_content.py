"""What a model or a data set says about itself: the part that lists and pages show. Read in workers and checkers only.

Both are read by the readers of `simcore`, which load no pickle and check every array.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from simcore.errors import NeedlebenchError

DATASET_ORIGIN_BYTES = 200_000  # of a provenance as JSON; the paper's data set, with 105 insertions, has 15 kB
MODEL_ORIGIN_BYTES = 50_000  # of which all but 5 kB is the scenario of its data set
LARGEST = 1e9  # of an error in a provenance, mm
LARGEST_SEED = 2**32


class NotLearnedError(NeedlebenchError, ValueError):
    """A file that is no model or no data set; the message, about "it", says why."""


def model_content(path: Path) -> dict[str, Any]:
    """Kind, settings and provenance of a model's file. Raises NotLearnedError."""
    from simcore.learning.trained import MAXIMUM_MB, REGRESSORS, ModelFaultError, TrainedModel, parse_model

    if path.stat().st_size > MAXIMUM_MB * 1e6:
        raise NotLearnedError(f"it holds {path.stat().st_size / 1e6:.0f} MB, at most {MAXIMUM_MB} are allowed")
    data = path.read_bytes()
    kind = _kind(data)
    if kind not in REGRESSORS:
        raise NotLearnedError(f"it is a model of kind {str(kind)[:100]!r}, known are {', '.join(REGRESSORS)}")
    try:
        model: TrainedModel = parse_model(data, kind)
    except ModelFaultError as wrong:
        raise NotLearnedError(f"it {wrong}") from None
    regressor = model.regressor
    _make_sure_of_settings(kind, regressor.settings())
    return {
        "kind": kind,
        "inputs": regressor.inputs,
        "outputs": regressor.outputs,
        "settings": regressor.settings(),
        "provenance": _short(model.provenance, MODEL_ORIGIN_BYTES),
    }


def _make_sure_of_settings(kind: str, settings: dict[str, Any]) -> None:
    """Settings of the types of a regressor's own: its constructor asks for their range only. Raises NotLearnedError."""
    from simcore.learning.trained import REGRESSORS

    for name, usual in REGRESSORS[kind]().settings().items():
        value = settings[name]
        whole = isinstance(value, int) and not isinstance(value, bool)
        if not (whole if isinstance(usual, int) else whole or isinstance(value, type(usual))):
            raise NotLearnedError(f"its setting {name} is {str(value)[:100]!r}, where {usual!r} would be one")
    if not 0 <= settings.get("seed", 0) <= LARGEST_SEED:
        raise NotLearnedError(f"its seed is {str(settings['seed'])[:100]}, it must be 0 to {LARGEST_SEED}")


def _kind(data: bytes) -> str:
    """The kind that a model's file names. Raises NotLearnedError for what is no model."""
    from simcore.learning.trained import FORMAT

    try:
        content = json.loads(data)
    except (ValueError, RecursionError) as error:
        raise NotLearnedError(f"it is not readable JSON: {error}") from None
    found = content.get("format") if isinstance(content, dict) else None
    if found != FORMAT:
        raise NotLearnedError(f"it is not a model: its format is {str(found)[:100]!r}, not {FORMAT!r}")
    return str(content.get("kind"))


def dataset_content(path: Path) -> dict[str, Any]:
    """Counts of a data set's file, and on how many rows each split learns and tests. Raises NotLearnedError."""
    from simcore.rollout.dataset import load_dataset

    try:
        data = load_dataset(path)
        origin = _short(data.provenance, DATASET_ORIGIN_BYTES)
        _make_sure_of_origin(origin)
        splits = {"sample": data.by_sample, "trajectory": data.by_trajectory}
        sides = {name: [len(split.train), len(split.test)] for name, split in splits.items()}
    except NotLearnedError:
        raise
    except (ValueError, TypeError, KeyError, IndexError) as error:
        raise NotLearnedError(str(error).replace(str(path), "it")[:300]) from None
    return {
        "rows": len(data.trajectory),
        "insertions": len(data.end_point_m),
        "drawn": len(data.drawn),
        "seed": data.seed,
        "splits": sides,
        "commit": origin.get("commit"),
        "dt_s": origin["scenario_template"]["dt_s"],
    }


def _make_sure_of_origin(origin: dict[str, Any]) -> None:
    """A model's provenance is taken from that of its data set. Raises NotLearnedError."""
    from benchmarks.learning.training import TRAINED_ON

    template = origin.get("scenario_template")
    needed = (*TRAINED_ON, "trajectory", "noise_mm", "controller")
    if not isinstance(template, dict) or "path_box_mm" not in origin:
        raise NotLearnedError("its provenance must have scenario_template and path_box_mm")
    missing = [name for name in needed if name not in template]
    if missing or not isinstance(template["trajectory"], dict):
        raise NotLearnedError(f"its provenance.scenario_template lacks {', '.join(missing) or 'a trajectory'}")
    _short({name: template[name] for name in needed}, MODEL_ORIGIN_BYTES - 5000)


def _short(origin: Any, most_bytes: int) -> dict[str, Any]:
    """The provenance, if it is JSON data without NaN and not too long. Raises NotLearnedError."""
    if not isinstance(origin, dict):
        raise NotLearnedError("its provenance must be a JSON object")
    try:
        length = len(json.dumps(origin, allow_nan=False))
    except (ValueError, RecursionError):
        raise NotLearnedError("its provenance holds numbers that are not finite") from None
    if length > most_bytes:
        raise NotLearnedError(f"its provenance holds {length / 1e3:.0f} kB, at most {most_bytes / 1e3:.0f} are allowed")
    return origin


def finite_axes(values: Any) -> list[float] | None:
    """Three errors (x, y, z) out of a provenance that somebody may have written by hand; None for anything else."""
    if not isinstance(values, list) or len(values) != 3:
        return None
    if not all(isinstance(v, int | float) and not isinstance(v, bool) and abs(v) < LARGEST for v in values):
        return None
    return [float(v) for v in values]
