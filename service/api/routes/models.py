"""Routes of models: what there is to steer by, and jobs that train more; and of the controllers that use them."""

from __future__ import annotations

from typing import Annotated, Any, get_args

from fastapi import APIRouter, Path, Query, Request, Response, status
from starlette.responses import FileResponse

from service.admission.training_request import TrainRequest, check_training
from service.api.context import ServiceOf, documented
from service.api.idempotency import IdempotencyKey, own_key
from service.api.problems import HttpProblem
from service.api.routes.jobs import LOCATION
from service.api.schemas.jobs import JobSummary, JobView
from service.api.schemas.models import ControllerInfo, ControllerList, ModelDetail, ModelList, ModelView
from service.files.upload_names import SCHEME
from service.store.job import TRAINING, content_hash
from service.store.models import MODEL_ID
from service.store.uploads import Upload
from service.worker.training_job import STAGES
from simcore.errors import Problem, ScenarioError
from simcore.scenario.controller_blocks import Controller, Learned

router = APIRouter(prefix="/api/v1", tags=["models"])

USERS = 20
_JSON = {"application/json": {"schema": {"type": "object"}}}

ModelId = Annotated[str, Path(description="Id of a model.", max_length=80, pattern=f"^{MODEL_ID}$")]


@router.get("/models", operation_id="list_models", summary="Models of learned controllers", responses=documented())
def list_models(
    service: ServiceOf,
    limit: Annotated[int, Query(ge=1, le=1000, description="At most so many of this service.")] = 100,
) -> ModelList:
    """Those that were trained here or sent in, newest first, then those that come along. A scenario steers by one with
    its `kind` as `controller.kind` and its `reference` as `controller.model`."""
    return ModelList(items=[ModelView.of(model) for model in service.models.all(limit=limit)])


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
    """Queue a job that learns from an uploaded data set, as `needlebench train` does. Its model is one of this service
    as soon as the job has succeeded; the same request gives the same model, to the last bit."""
    service.refuse_when_closing()
    training = body.resolved()
    data = _data(service.uploads.find(body.data.removeprefix(SCHEME)), body.data)
    check_training(training, data, service.settings.limits)
    owner = request.state.caller.key_id
    job = service.store.submit(
        kind=TRAINING,
        name=body.name or f"{body.kind} from {data.name}"[:100],
        spec={"training": training},
        spec_hash=content_hash(training),
        steps=len(STAGES),
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


def _data(found: Upload | None, reference: str) -> Upload:
    if found is None:
        message = "is no upload of this service, or was deleted: send the file with `needlebench upload`"
        raise ScenarioError([Problem("data", reference, message)])
    return found


@router.get("/models/{model_id}", operation_id="get_model", summary="One model", responses=documented(404))
def get_model(model_id: ModelId, service: ServiceOf) -> ModelDetail:
    """Its settings, where it comes from, its errors, and the last jobs that steer by it."""
    model = service.models.get(model_id)
    users = [JobSummary.of(job) for job in service.models.used_by(model, limit=USERS)]
    fields = ModelDetail.fields_of(model)
    return ModelDetail(**fields, settings=model.settings, provenance=model.provenance, used_by=users)


@router.get(
    "/models/{model_id}/content",
    operation_id="get_model_content",
    summary="The file of a model",
    response_class=FileResponse,
    responses={200: {"content": _JSON}, **documented(400, 404, 416)},
)
def get_model_content(model_id: ModelId, service: ServiceOf) -> Response:
    """As `controller.model` takes it on the command line."""
    model = service.models.get(model_id)
    if not model.path.is_file():
        raise HttpProblem(404, f"{model_id} is no longer in the data folder")
    headers = {"ETag": f'"{model.sha256}"', "Cache-Control": "no-cache"}
    return FileResponse(model.path, media_type="application/json", filename=model.name, headers=headers)


@router.get("/controllers", operation_id="list_controllers", summary="Kinds of controllers", responses=documented())
def list_controllers() -> ControllerList:
    """What `controller` of a scenario can be, with the schema and the defaults of each."""
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
