"""The JSON of models and of controllers."""

from __future__ import annotations

from datetime import datetime
from typing import Any, Self

from pydantic import BaseModel, Field

from service.admission.training_request import ModelKind
from service.api.schemas.jobs import JobSummary, moment
from service.files.model_content import finite_axes
from service.store.models import Model, Source

LARGEST = 2**53  # of a whole number that every reader of JSON takes as it is


class ModelView(BaseModel):
    """A model in a list. What it says about its training is null where its file does not say so."""

    id: str = Field(description="Its kind for one that comes along, else that of its upload.")
    reference: str = Field(description="What a scenario writes as controller.model to steer by it.")
    source: Source = Field(description="It came along, was sent in, or was trained by a job.")
    kind: ModelKind = Field(description="What a scenario writes as controller.kind to steer by it.")
    name: str
    nodes: int | None = Field(description="Of an elm.")
    seed: int | None
    split: str | None = Field(description="How test rows were held out: sample or trajectory.")
    train_rows: int | None
    test_rows: int | None
    train_rmse_mm: list[float] | None = Field(description="Of Delta P along x, y, z, before the robot's limits.")
    test_rmse_mm: list[float] | None
    data_sha256: str | None = Field(description="Of the data set that it learned from.")
    tissue: dict[str, Any] | None = Field(description="That it was trained in.")
    needle: dict[str, Any] | None = Field(description="That it was trained with.")
    sha256: str
    bytes: int
    pinned: bool = Field(description="Kept whatever is cleared away.")
    job: str | None = Field(description="Id of the job that trained it, which may be deleted since.")
    created_at: datetime | None = Field(description="Null for one that comes along.")
    url: str = Field(description="Where its file is.")

    @classmethod
    def fields_of(cls, model: Model) -> dict[str, Any]:
        origin = model.provenance
        trained_on = _as(dict, origin.get("trained_on")) or {}
        same = ("id", "reference", "source", "kind", "name", "sha256", "bytes", "pinned")
        return {
            **{name: getattr(model, name) for name in same},
            "nodes": _as(int, model.settings.get("nodes")),
            "seed": _as(int, model.settings.get("seed")),
            "split": _as(str, origin.get("split")),
            "train_rows": _as(int, origin.get("train_rows")),
            "test_rows": _as(int, origin.get("test_rows")),
            "train_rmse_mm": finite_axes(origin.get("train_rmse_mm")),
            "test_rmse_mm": finite_axes(origin.get("test_rmse_mm")),
            "data_sha256": _as(str, origin.get("data_sha256")),
            "tissue": _as(dict, trained_on.get("tissue")),
            "needle": _as(dict, trained_on.get("needle")),
            "job": model.job_id,
            "created_at": moment(model.created_at),
            "url": f"/api/v1/models/{model.id}/content",
        }

    @classmethod
    def of(cls, model: Model) -> Self:
        return cls(**cls.fields_of(model))


class ModelDetail(ModelView):
    """A model with all that its file says but its arrays, and the last jobs that steer by it."""

    settings: dict[str, Any] = Field(description="Of its regressor.")
    provenance: dict[str, Any] = Field(description="Where it comes from, as its file says.")
    used_by: list[JobSummary] = Field(description="The last 20 jobs that steer by it.")


class ModelList(BaseModel):
    items: list[ModelView]


class ControllerInfo(BaseModel):
    """A kind of controller."""

    kind: str
    description: str
    learned: bool = Field(description="Whether it steers by a model; see /api/v1/models.")
    defaults: dict[str, Any] = Field(description="Every field that has a default, as `controller` of a scenario.")
    schema_: dict[str, Any] = Field(alias="schema", description="JSON schema of its fields.")


class ControllerList(BaseModel):
    items: list[ControllerInfo]


def _as(kind: type, value: Any) -> Any:
    """The value if it is of this type: a provenance may have been written by hand."""
    if not isinstance(value, kind) or isinstance(value, bool):
        return None
    return None if isinstance(value, int) and abs(value) > LARGEST else value
