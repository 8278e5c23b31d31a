"""The JSON of models and of controllers."""

from __future__ import annotations

from datetime import datetime
from typing import Any, Self

from pydantic import BaseModel, Field

from service.admission.training_request import ModelKind
from service.api.root_path import rooted
from service.api.schemas.jobs import JobSummary
from service.api.schemas.timestamps import utc
from service.files.model_content import finite_axes
from service.store.models import Model, Source

LARGEST = 2**53  # integer that every reader of JSON keeps exact
JOBS_SHOWN = 20


class ModelView(BaseModel):
    """A model in a list. Facts about its training are null where its file does not give them."""

    id: str = Field(description="Its kind if it is bundled, else the id of its upload.")
    reference: str = Field(description="The value of controller.model to steer by it.")
    source: Source = Field(description="Whether it is bundled, was uploaded, or was trained by a job.")
    kind: ModelKind = Field(description="The value of controller.kind to steer by it.")
    name: str
    nodes: int | None = Field(description="Of an elm.")
    seed: int | None
    split: str | None = Field(description="How test rows were held out: sample or trajectory.")
    train_rows: int | None
    test_rows: int | None
    train_rmse_mm: list[float] | None = Field(description="Of Delta P along x, y, z, before the robot's limits.")
    test_rmse_mm: list[float] | None
    data_sha256: str | None = Field(description="Of the data set that it was trained on.")
    tissue: dict[str, Any] | None = Field(description="The tissue that it was trained in.")
    needle: dict[str, Any] | None = Field(description="The needle that it was trained with.")
    sha256: str
    bytes: int
    pinned: bool = Field(description="Kept when old uploads are removed.")
    job: str | None = Field(description="Id of the job that trained it, which may have been deleted since.")
    created_at: datetime | None = Field(description="Null for a bundled one.")
    url: str = Field(description="Address of its file.")

    @classmethod
    def fields_of(cls, model: Model) -> dict[str, Any]:
        """Its fields by name, for this class and those that extend it."""
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
            "created_at": utc(model.created_at),
            "url": rooted(f"/api/v1/models/{model.id}/content"),
        }

    @classmethod
    def of(cls, model: Model) -> Self:
        """The JSON of a model in a list."""
        return cls(**cls.fields_of(model))


class ModelDetail(ModelView):
    """A model with everything in its file but the arrays, and the last jobs that steer by it."""

    settings: dict[str, Any] = Field(description="Settings of its regressor.")
    provenance: dict[str, Any] = Field(description="Provenance, from its file.")
    used_by: list[JobSummary] = Field(description=f"The last {JOBS_SHOWN} jobs that steer by it.")


class ModelList(BaseModel):
    """Models: trained and uploaded ones newest first, then the bundled ones; next_cursor leads on, null at the end."""

    items: list[ModelView]
    next_cursor: str | None


class ControllerInfo(BaseModel):
    """A kind of controller."""

    kind: str
    description: str
    learned: bool = Field(description="Whether it steers by a model; see /api/v1/models.")
    defaults: dict[str, Any] = Field(description="Every field that has a default, as `controller` of a scenario.")
    schema_: dict[str, Any] = Field(alias="schema", description="JSON schema of its fields.")


class ControllerList(BaseModel):
    """The kinds of controllers."""

    items: list[ControllerInfo]


def _as(kind: type, value: Any) -> Any:
    """The value if it is of this type, else None: a provenance may have been written by hand."""
    if not isinstance(value, kind) or isinstance(value, bool):
        return None
    return None if isinstance(value, int) and abs(value) > LARGEST else value
