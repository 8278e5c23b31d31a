"""Routes of models: the list, the jobs that train more; and of the controllers that use them."""

from __future__ import annotations

from typing import Annotated, Any, get_args

from fastapi import APIRouter, Query, Request, Response, status
from starlette.responses import FileResponse

from service.admission.training_request import STEPS, TrainRequest, check_training
from service.api.context import ServiceOf
from service.api.idempotency import IdempotencyKey, own_key
from service.api.json_bodies import JsonBodyRoute
from service.api.openapi import documented
from service.api.parameters import Cursor, ModelId
from service.api.routes.jobs import LOCATION
from service.api.schemas.jobs import JobSummary, JobView
from service.api.schemas.models import JOBS_SHOWN, ControllerInfo, ControllerList, ModelDetail, ModelList, ModelView
from service.api.served_file import served_file
from service.files.upload_names import SCHEME
from service.store.job import TRAINING, content_hash
from service.store.uploads import Upload
from simcore.errors import Problem, ScenarioError
from simcore.scenario.controller_blocks import Controller, Learned

router = APIRouter(prefix="/api/v1", tags=["models"], route_class=JsonBodyRoute)

_JSON = {"application/json": {"schema": {"type": "object"}}}


@router.get("/models", operation_id="list_models", summary="Models of learned controllers", responses=documented())
def list_models(
    service: ServiceOf,
    limit: Annotated[int, Query(ge=1, le=1000, description="Most uploaded and trained ones in the list.")] = 100,
    cursor: Cursor = None,
) -> ModelList:
    """Those that were trained or uploaded here, newest first, then the bundled ones. To steer by one, a scenario sets
    `controller.kind` to its `kind` and `controller.model` to its `reference`."""
    page = service.models.page(size=limit, cursor=cursor)
    return ModelList(items=[ModelView.of(model) for model in page.items], next_cursor=page.next_cursor)


@router.post(
    "/models/train",
    operation_id="train_model",
    summary="Train a model",
    status_code=status.HTTP_202_ACCEPTED,
    response_model=JobView,
    responses={202: {"description": "Queued.", "headers": LOCATION}, **documented(400, 413, 415, 503)},
)
def train_model(
    body: TrainRequest,
    service: ServiceOf,
    request: Request,
    response: Response,
    idempotency_key: IdempotencyKey = None,
) -> JobView:
    """Queue a job that learns from an uploaded data set, as `needlebench train` does. Its model is listed once the job
    has finished; the same request gives the same model, to the last bit."""
    service.refuse_when_closing()
    request.state.caller.require_priority(body.priority)
    training = body.resolved()
    data = _data(service.uploads.find(body.data.removeprefix(SCHEME)), body.data)
    check_training(training, data, service.settings.limits)
    owner = request.state.caller.key_id
    job = service.store.submit(
        kind=TRAINING,
        name=body.name or f"{body.kind} from {data.name}"[:100],
        spec={"training": training},
        spec_hash=content_hash(training),
        steps=STEPS,
        priority=body.priority,
        timeout_s=body.timeout_s,
        key=own_key(idempotency_key, owner),
        request_hash=content_hash([training, body.name, body.priority, body.timeout_s]),
        owner=owner,
        uploads=[data.id],
    )
    service.engine.wake()
    response.headers["Location"] = f"/api/v1/jobs/{job.id}"
    return JobView.of(job)


def _data(upload: Upload | None, reference: str) -> Upload:
    if upload is None:
        message = "is not an upload of this service, or was deleted: send the file with `needlebench upload`"
        raise ScenarioError([Problem("data", reference, message)])
    return upload


@router.get("/models/{model_id}", operation_id="get_model", summary="One model", responses=documented(404))
def get_model(model_id: ModelId, service: ServiceOf) -> ModelDetail:
    """Its settings, provenance and errors, and the last jobs that steer by it."""
    model = service.models.get(model_id)
    users = [JobSummary.of(job) for job in service.models.used_by(model, limit=JOBS_SHOWN)]
    fields = ModelDetail.fields_of(model)
    return ModelDetail(**fields, settings=model.settings, provenance=model.provenance, used_by=users)


@router.get(
    "/models/{model_id}/content",
    operation_id="get_model_content",
    summary="The file of a model",
    response_class=FileResponse,
    responses={200: {"content": _JSON}, **documented(400, 404, 410, 416)},
)
def get_model_content(model_id: ModelId, service: ServiceOf, request: Request) -> Response:
    """As `controller.model` takes it on the command line."""
    model = service.models.get(model_id)
    return served_file(
        request,
        model.path,
        sha256=model.sha256,
        size=model.bytes,
        media_type="application/json",
        filename=model.name,
    )


@router.get("/controllers", operation_id="list_controllers", summary="Kinds of controllers", responses=documented())
def list_controllers() -> ControllerList:
    """The kinds that `controller` of a scenario can have, with the schema and the defaults of each."""
    blocks = get_args(get_args(Controller)[0])
    return ControllerList(items=[_info(block) for block in blocks])


def _info(block: Any) -> ControllerInfo:
    required = [name for name, field in block.model_fields.items() if field.is_required()]
    defaults = block.model_construct().model_dump(mode="json", exclude=set(required))
    return ControllerInfo(
        kind=block.model_fields["kind"].default,
        description=" ".join((block.__doc__ or "").split()),
        learned=issubclass(block, Learned),
        defaults=defaults,
        schema=block.model_json_schema(),
    )
