"""Everything about a job in one archive: job, scenario, result, series, recording, log."""

from __future__ import annotations

import io
import json
from pathlib import Path
from typing import Any, NamedTuple

from service.api.context import Service
from service.api.problems import HttpError
from service.api.schemas.jobs import JobView
from service.api.served_file import check_intact
from service.files.zip_stream import ZipEntry
from service.logs import LOG
from service.store.job import Artefact, Job


class Part(NamedTuple):
    """One file of the archive. source: its bytes, or where they lie."""

    name: str
    bytes: int
    source: bytes | Path
    artefact: Artefact | None = None


def archive_parts(service: Service, job: Job) -> list[Part]:
    """What the archive of a job that has ended holds, with sizes; nothing of it is read."""
    spec = job.spec or {}
    texts = {"job.json": json.loads(JobView.of(job).model_dump_json(exclude={"scenario", "training", "result"}))}
    texts |= {f"{name}.json": spec[name] for name in ("scenario", "training") if name in spec}
    parts = [_text(name, value) for name, value in texts.items()]
    parts += [
        Part(one.name, one.bytes, service.settings.data / one.path, one) for one in service.store.artefacts(job.id)
    ]
    log = service.settings.data / job.folder / LOG
    if log.is_file() and LOG not in {part.name for part in parts}:  # of an attempt that left no result
        parts.append(Part(LOG, log.stat().st_size, log))
    return parts


def _text(name: str, value: Any) -> Part:
    text = json.dumps(value, indent=2, ensure_ascii=False).encode()
    return Part(name, len(text), text)


def open_parts(parts: list[Part]) -> list[ZipEntry]:
    """The parts, open: what is deleted from now on is still read. Raises HttpError 404 for a file that is gone and
    DamagedFileError for one that is not what was written."""
    for part in parts:
        if part.artefact is not None and isinstance(part.source, Path):
            check_intact(part.source, sha256=part.artefact.sha256, size=part.bytes, name=part.name)
    entries: list[ZipEntry] = []
    try:
        for part in parts:
            content = io.BytesIO(part.source) if isinstance(part.source, bytes) else part.source.open("rb")
            entries.append(ZipEntry(part.name, part.bytes, content))
    except OSError:
        for entry in entries:
            entry.content.close()
        raise HttpError(404, f"{part.name} is no longer in the data folder", code="file-missing") from None
    return entries
