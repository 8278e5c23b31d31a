"""A request to train: which regressor learns from which data set, and what that costs, before it is queued."""

from __future__ import annotations

import importlib.util
import math
from typing import TYPE_CHECKING, Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field

from service.files.upload_names import SCHEME, UPLOAD_ID
from service.store.job import Label
from service.worker.training_job import SETTINGS, STAGES, new_regressor
from simcore.errors import Problem, ScenarioError

if TYPE_CHECKING:
    from service.settings import Limits
    from service.store.uploads import Upload

ModelKind = Literal["elm", "linear", "neighbours", "mlp"]
STEPS = len(STAGES)  # of a training job
BASE_MB = 400.0  # Python with the libraries of a training
COPIES = 4  # of the table that the ridge solution is computed from
BYTES_OF_A_NUMBER = 26  # in a model's file


class TrainRequest(BaseModel):
    """A model to be trained. Only settings of its kind may be given; null = the default of the kind."""

    model_config = ConfigDict(
        extra="forbid",
        json_schema_extra={
            "examples": [
                {"data": f"{SCHEME}{'0' * 64}.npz", "kind": "elm", "nodes": 25, "seed": 7},
                {"data": f"{SCHEME}{'0' * 64}.npz", "kind": "neighbours", "neighbours": 5, "split": "trajectory"},
            ]
        },
    )

    data: Annotated[
        str, Field(pattern=rf"^{SCHEME}{UPLOAD_ID}$", max_length=100, description="The data set: artefact:ID.")
    ]
    kind: Annotated[ModelKind, Field(description="Of the regressor and of the controller that steers by it.")] = "elm"
    name: Annotated[Label | None, Field(description="Its name in lists.")] = None
    nodes: Annotated[int | None, Field(strict=True, ge=1, le=10_000, description="Of the elm; 25 [paper].")] = None
    ridge: Annotated[
        float | None,
        Field(strict=True, ge=0, le=1e6, allow_inf_nan=False, description="Of elm and linear; 1e-6 [ours]."),
    ] = None
    weight_range: Annotated[
        float | None,
        Field(strict=True, ge=1e-3, le=100, allow_inf_nan=False, description="Of w and b of the elm; 1 [ours]."),
    ] = None
    seed: Annotated[int | None, Field(strict=True, ge=0, le=2**31, description="Of elm and mlp; 0.")] = None
    neighbours: Annotated[int | None, Field(strict=True, ge=1, le=1000, description="Of neighbours; 10 [ours].")] = None
    hidden: Annotated[
        list[Annotated[int, Field(strict=True, ge=1, le=1000)]] | None,
        Field(min_length=1, max_length=5, description="Nodes of each hidden layer of the mlp; 32, 32 [ours]."),
    ] = None
    split: Annotated[
        Literal["sample", "trajectory"],
        Field(description="How 10 % are held out: single rows [paper], or whole insertions."),
    ] = "sample"
    samples: Annotated[
        int | None, Field(strict=True, ge=2, le=10**9, description="Learn from only so many rows; default: all.")
    ] = None
    priority: Annotated[int, Field(strict=True, ge=-100, le=100, description="Higher runs first.")] = 0
    timeout_s: Annotated[
        float, Field(strict=True, ge=1, le=86400, allow_inf_nan=False, description="Most wall time of an attempt.")
    ] = 3600.0

    def resolved(self) -> dict[str, Any]:
        """The specification for the worker: data, kind, every setting, split, samples. Raises ScenarioError."""
        known = SETTINGS[self.kind]
        every = dict.fromkeys(name for names in SETTINGS.values() for name in names)
        given = {name: value for name in every if (value := getattr(self, name)) is not None}
        problems = [
            Problem(name, value, f"is not a setting of {self.kind}, which has {', '.join(known)}")
            for name, value in given.items()
            if name not in known
        ]
        if self.kind == "mlp" and importlib.util.find_spec("sklearn") is None:
            problems.append(Problem("kind", self.kind, "needs scikit-learn, which the service does not have"))
        if problems:
            raise ScenarioError(problems)
        from simcore.learning.regressor import DataError

        try:
            settings = new_regressor(self.kind, given).settings()
        except DataError as error:
            raise ScenarioError([Problem("kind", self.kind, str(error))]) from None
        names = ("data", "kind", "split", "samples")
        return {**{name: getattr(self, name) for name in names}, "settings": settings}


def settings_by_kind() -> dict[str, tuple[str, ...]]:
    """The names of the settings that each kind of model has."""
    return SETTINGS


def check_training(training: dict[str, Any], data: Upload, limits: Limits) -> None:
    """Raises ScenarioError unless the data set suits the training and the cost is within the limits."""
    from simcore.learning.trained import MAXIMUM_MB

    reference = training["data"]
    if data.kind != "dataset":
        raise ScenarioError([Problem("data", reference, f"is a {data.kind}, not a data set")])
    training_rows, test_rows = data.content["splits"][training["split"]]
    if not training_rows or not test_rows:
        message = f"leaves {training_rows} rows to learn from and {test_rows} to test on: the data set is too small"
        raise ScenarioError([Problem("split", training["split"], message)])
    rows = min(training_rows, training["samples"] or training_rows)
    memory_mb, file_mb = cost_mb(training, rows, data.content["rows"])
    field = {"elm": "nodes", "mlp": "hidden"}.get(training["kind"], "samples")
    value = training["settings"].get(field, training["samples"])
    estimate = f"(estimate: {rows} rows, {memory_mb:.0f} MB of memory, a file of {file_mb:.3g} MB)"
    if memory_mb > limits.job_memory_mb:
        message = f"needs about {memory_mb:.0f} MB, at most {limits.job_memory_mb} are allowed here {estimate}"
        raise ScenarioError([Problem(field, value, message)])
    if file_mb > MAXIMUM_MB:
        message = f"makes a model of about {file_mb:.0f} MB, at most {MAXIMUM_MB} are allowed {estimate}"
        raise ScenarioError([Problem(field, value, message)])


def cost_mb(training: dict[str, Any], rows: int, all_rows: int) -> tuple[float, float]:
    """Memory of the training and size of the model's file, MB. Accurate to about a factor of two."""
    from simcore.learning.trained import INPUTS, OUTPUTS

    settings, kind = training["settings"], training["kind"]
    shapes = new_regressor(kind, settings).shapes(INPUTS, OUTPUTS)
    numbers = sum(math.prod(rows if length == -1 else length for length in shape) for shape in shapes.values())
    columns = settings["nodes"] if kind == "elm" else INPUTS
    solved = COPIES * (rows + columns) * columns if kind in ("elm", "linear") else 0
    memory_mb = BASE_MB + 8e-6 * (solved + 40 * all_rows + 20 * numbers)
    return memory_mb, BYTES_OF_A_NUMBER * numbers * 1e-6
