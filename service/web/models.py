"""The pages of models: the list with the form of a training, one model with its errors and the jobs that use it."""

from __future__ import annotations

from dataclasses import dataclass

from fastapi import APIRouter, Request, Response

from service.admission.training_request import TrainRequest, settings_by_kind
from service.api.context import ServiceOf
from service.api.parameters import ModelId
from service.api.schemas.jobs import JobSummary
from service.api.schemas.models import JOBS_SHOWN, ModelView
from service.api.schemas.uploads import UploadView
from service.display import flat
from service.store.job import UnknownJobError
from service.store.models import UnknownModelError
from service.web.job_facts import AXES
from service.web.site import missing, page

router = APIRouter(include_in_schema=False)

ROWS = 200
WIDTH, BAR, GAP, LEFT, RIGHT = 420, 14, 16, 24, 74  # of the drawing of errors, pixels


@router.get("/models")
def get_models(request: Request, service: ServiceOf) -> Response:
    """All models and data sets, and the form of a training."""
    schema = TrainRequest.model_json_schema()["properties"]
    return page(
        request,
        "models.html",
        models=[ModelView.of(model) for model in service.models.all(limit=ROWS)],
        datasets=[UploadView.of(one) for one in service.uploads.newest(limit=ROWS, kind="dataset")],
        settings=settings_by_kind(),
        about={name: field["description"] for name, field in schema.items()},
    )


@router.get("/models/{model_id}")
def get_model(model_id: ModelId, request: Request, service: ServiceOf) -> Response:
    """One model: what it is, how it was trained, its errors, the jobs that steer by it."""
    try:
        model = service.models.get(model_id)
    except UnknownModelError:
        return missing(request, f"model {model_id}")
    view = ModelView.of(model)
    data = [one for one in service.uploads.newest(limit=ROWS, kind="dataset") if one.sha256 == view.data_sha256]
    return page(
        request,
        "model.html",
        model=view,
        settings=list(flat(model.settings)),
        origin=list(flat(model.provenance)),
        drawing=errors_drawing(view.train_rmse_mm, view.test_rmse_mm),
        data=UploadView.of(data[0]) if data else None,
        trained_by=_existing(service, view.job),
        users=[JobSummary.of(job) for job in service.models.used_by(model, limit=JOBS_SHOWN)],
    )


def _existing(service: ServiceOf, job_id: str | None) -> str | None:
    """The job, unless it was deleted."""
    try:
        return None if job_id is None else service.store.get_summary(job_id).id
    except UnknownJobError:
        return None


@dataclass(frozen=True, kw_only=True)
class Bar:
    """One error in the drawing. axis: x, y or z for the first of its pair, else nothing."""

    axis: str
    side: str
    y: int
    width: float
    value_mm: float


@dataclass(frozen=True, kw_only=True)
class Drawing:
    """Errors as bars, pixels."""

    width: int
    height: int
    left: int
    thick: int
    bars: tuple[Bar, ...]
    text: str


def errors_drawing(train_mm: list[float] | None, test_mm: list[float] | None) -> Drawing | None:
    """Root mean square errors along x, y, z as pairs of bars; None without them."""
    if train_mm is None or test_mm is None:
        return None
    largest = max(*train_mm, *test_mm) or 1.0
    bars = []
    for number, axis in enumerate(AXES):
        for which, (side, values) in enumerate((("train", train_mm), ("test", test_mm))):
            y = number * (2 * BAR + GAP) + which * BAR
            length = max(0.0, (WIDTH - LEFT - RIGHT) * values[number] / largest)
            bars.append(
                Bar(axis="" if which else axis, side=side, y=y, width=round(length, 1), value_mm=values[number])
            )
    errors = "; ".join(f"{axis} {train_mm[i]:.3f} and {test_mm[i]:.3f}" for i, axis in enumerate(AXES))
    text = f"Root mean square error of Delta P in mm, on training rows and on test rows: {errors}"
    height = 3 * (2 * BAR + GAP) - GAP + 4
    return Drawing(width=WIDTH, height=height, left=LEFT, thick=BAR - 2, bars=tuple(bars), text=text)
