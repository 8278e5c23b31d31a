"""What one worker process does with one job. Knows no database, no engine and no HTTP.

`run_job` is the whole contract with an engine: a JSON specification and a folder in, a JSON result out.
"""

from __future__ import annotations

import hashlib
import importlib
import logging
import os
import signal
import sys
import time
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from service.files.disk import REFUSALS
from service.files.strict_json import NotJsonError, plain_json
from service.logs import LOG, ROOT, job_log
from service.worker.failures import described_with_place, storable
from service.worker.guard import captured_descriptors
from service.worker.leftovers import Belongings, end_leftovers
from service.worker.progress import ProgressFile
from service.worker.specs import AttemptReport, InsertionSpec
from service.worker.training_job import MODEL

if TYPE_CHECKING:
    from collections.abc import Iterator

    from simcore.rollout.records import Observer, Scene, StepRecord
    from simcore.rollout.result import Rollout
    from simcore.scenario.scenario import Scenario

KINDS = {"result.json": "result", "series.npz": "series", "recording.rrd": "recording", LOG: "log"}
RESULT_MB = 64  # of a result, as JSON
Failure = tuple[str | None, str | None]  # kind and message of the error that an attempt ended with
_log = logging.getLogger(ROOT)


class WorkerStop(BaseException):
    """The worker was asked to stop; not an Exception, so that nothing between here and the kernel swallows it."""


@dataclass(frozen=True)
class ObserverGroup:
    """Several observers of one run."""

    observers: tuple[Observer, ...]

    def begin(self, scene: Scene, first: StepRecord) -> None:
        """Hand it to each."""
        for observer in self.observers:
            observer.begin(scene, first)

    def step(self, record: StepRecord) -> None:
        """Hand it to each."""
        for observer in self.observers:
            observer.step(record)

    def end(self, rollout: Rollout) -> None:
        """Hand it to each."""
        for observer in self.observers:
            observer.end(rollout)


def run_job(spec: dict[str, Any], artefact_dir: Path) -> dict[str, Any]:
    """Run an insertion; write result.json, series.npz and, if wanted, recording.rrd into the folder.

    spec: of an InsertionSpec. Returns the JSON of result.json. A run that did not succeed or converge is a result like
    any other.
    """
    from simcore.rollout import artefacts, rollout
    from simcore.scenario.scenario import Scenario

    job = InsertionSpec.from_json(spec)
    with ExitStack() as stack:
        stack.enter_context(job.file_names())
        scenario = Scenario.load(job.scenario)
        _log.info("job %s: scenario %r, %d steps, seed %d", job.job_id, scenario.name, scenario.steps, scenario.seed)
        for warning in scenario.warnings():
            _log.warning("%s", warning)
        observers: list[Observer] = [ProgressFile(artefact_dir)]
        if scenario.recording.enabled:
            recorder = _recorder(scenario, job.job_id, artefact_dir / "recording.rrd")
            observers.append(stack.enter_context(recorder))
        done = rollout.run(scenario, ObserverGroup(tuple(observers)))
    for warning in done.warnings:
        _log.warning("%s", warning)
    artefacts.write(done, artefact_dir)
    _log.info("%s %s success=%s digest=%s", done.status, done.message, done.success, done.digest)
    return done.result()


@contextmanager
def _recorder(scenario: Scenario, job_id: str, path: Path) -> Iterator[Observer]:
    """A recorder of the job; a recording that went wrong is logged and changes nothing else."""
    from service.recording.observer import RerunObserver
    from simcore.provenance import provenance

    origin = {"job_id": job_id, **provenance(scenario.resolved())}
    del origin["scenario"]  # the recorder stores it by itself
    with RerunObserver(path, recording_id=job_id, provenance=origin) as recorder:
        yield recorder
    if recorder.warning is not None:
        _log.warning("job %s: %s", job_id, recorder.warning)


def execute(runner: str, spec: dict[str, Any], folder: str) -> AttemptReport:
    """Do a job with `runner` (module:function) in an empty folder; what it left, or why not, and what it cost.

    Nothing is raised, and the report is plain JSON: an exception in the engine means that the process is gone.
    """
    target = Path(folder)
    started_s = time.process_time()
    result: Any = None
    failure: Failure = (None, None)
    files: list[dict[str, Any]] = []
    left: tuple[str, ...] = ()
    with stoppable():
        try:
            target.mkdir(parents=True, exist_ok=True)
            with job_log(target / LOG):
                result, failure, left = _run_and_clear(runner, spec, target)
            files = describe(target)
        except OSError as error:  # not even the folder or its log
            failure = ("disk", _describe_failure(spec, error))
        except Exception as error:  # noqa: BLE001  (what a job did to its process must not end that)
            failure = ("exception", _describe_failure(spec, error))
    return AttemptReport(
        result=None if failure[1] else result,
        error_kind=failure[0],
        error=failure[1],
        artefacts=tuple(files),
        cpu_s=time.process_time() - started_s,
        max_rss_mb=peak_rss_mb(),
        leftovers=left,
    )


def _run_and_clear(runner: str, spec: dict[str, Any], target: Path) -> tuple[Any, Failure, tuple[str, ...]]:
    """The result or the error in its place, and what the job left in this process."""
    with captured_descriptors(target / LOG) as capture:
        before = Belongings.now()
        result, failure = _run(runner, spec, target)
        left = end_leftovers(before, strict=_has_plugin(spec))
    if not capture.whole:
        left = (*left, "an open output")
    if left:
        _log.warning("job %s left %s: its process is not used again", spec.get("job_id"), ", ".join(left))
    return result, failure, left


def _has_plugin(spec: dict[str, Any]) -> bool:
    """Whether code of another package takes part."""
    controller = (spec.get("scenario") or {}).get("controller")
    return isinstance(controller, dict) and controller.get("kind") == "plugin"


def _run(runner: str, spec: dict[str, Any], target: Path) -> tuple[Any, Failure]:
    """The result, or kind and message of the error in its place."""
    try:
        return plain_json(resolve(runner)(spec, target), most_mb=RESULT_MB), (None, None)
    except WorkerStop:
        raise
    except NotJsonError as error:
        _log.error("job %s failed: its result %s", spec.get("job_id"), error)
        return None, ("exception", storable(f"its result {error}"))
    except MemoryError as error:
        return None, ("out_of_memory", _describe_failure(spec, error))
    except OSError as error:
        return None, ("disk" if error.errno in REFUSALS else "exception", _describe_failure(spec, error))
    except BaseException as error:  # noqa: BLE001  (whatever a runner raises is how its attempt ended)
        return None, ("exception", _describe_failure(spec, error))


def _describe_failure(spec: dict[str, Any], failure: BaseException) -> str:
    """What was raised and the place; the whole trace goes to the log."""
    with suppress(Exception):  # a trace that cannot be written is not how the job ended
        _log.error("job %s failed", spec.get("job_id"), exc_info=failure)
    return described_with_place(failure)


def resolve(name: str) -> Any:
    """The function behind `module:function`."""
    module, _, function = name.partition(":")
    return getattr(importlib.import_module(module), function)


@contextmanager
def stoppable() -> Iterator[None]:
    """A SIGTERM raises WorkerStop between two steps, so that a recording is closed; then the process ends."""

    def stop(_signal: int, _frame: Any) -> None:
        raise WorkerStop

    before = signal.signal(signal.SIGTERM, stop)
    try:
        yield
    except WorkerStop:
        os._exit(128 + signal.SIGTERM)
    finally:
        signal.signal(signal.SIGTERM, before)


def describe(folder: Path) -> list[dict[str, Any]]:
    """Kind, name, SHA-256 and size of each file that a finished attempt left; temporary names are passed over."""
    files = []
    for name, kind in {**KINDS, MODEL: "model"}.items():
        path = folder / name
        if path.is_file():
            with path.open("rb") as file:
                digest = hashlib.file_digest(file, "sha256").hexdigest()
            files.append({"kind": kind, "name": name, "sha256": digest, "bytes": path.stat().st_size})
    return files


def peak_rss_mb() -> float | None:
    """The most memory that this process ever held, MiB; None where nobody counts.

    Linux' ru_maxrss begins with that of the process which started this one, so its own high-water mark is read there.
    """
    if sys.platform == "linux":
        for line in Path("/proc/self/status").read_text().splitlines():
            if line.startswith("VmHWM:"):
                return int(line.split()[1]) / 2**10
    if sys.platform == "win32":
        return None
    import resource

    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak / (2**20 if sys.platform == "darwin" else 2**10)


def warm_up() -> None:
    """Import all that a job needs and compile the kernels that nearly every job needs, or load them from the cache."""
    import service.recording.observer  # noqa: F401  (imports Rerun)
    from simcore.rollout.rollout import compile_kernels

    compile_kernels(exact=False, linearised=False)
