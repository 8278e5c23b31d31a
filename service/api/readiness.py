"""The state of a running service: what `/readyz` answers, and the gauges of `/metrics`."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress

from service.api.context import Service
from service.engine.health_checks import Check, Level, database_check, disk_check, folder_check
from service.engine.metrics import Reading
from service.files.disk import free_bytes, free_files


def checks(service: Service) -> list[Check]:
    """Every check of a running service, the slowest last."""
    settings = service.settings
    return [
        _open(service),
        _workers(service),
        _threads(service),
        disk_check(settings.data, settings.minimum_free_bytes),
        folder_check(settings.data),
        database_check(service.store),
    ]


def _open(service: Service) -> Check:
    if service.closing:
        return Check(name="service", level="bad", found="is shutting down", advice="wait until it is back")
    return Check(name="service", level="ok", found="accepts jobs")


def _workers(service: Service) -> Check:
    engine = service.engine
    state = f"{engine.ready} of {engine.slots} workers are warm"
    if engine.ready == engine.slots:
        return Check(name="workers", level="ok", found=state)
    if engine.problem is None:
        return Check(name="workers", level="warn", found=state, advice="wait: they are starting and compiling")
    level: Level = "warn" if engine.ready else "bad"
    return Check(name="workers", level=level, found=f"{state}: {engine.problem}", advice="see the log of the service")


def _threads(service: Service) -> Check:
    """Whether every thread that jobs need lives and gets on."""
    engine, keeper = service.engine, service.keeper
    ended = [*engine.ended_threads, *([keeper.name] if keeper.ended else [])]
    silent = engine.silent_slots
    if not ended and not silent:
        return Check(name="threads", level="ok", found="all of them get on")
    found = [f"{name} has ended" for name in ended] + [f"{name} has not got on for a minute" for name in silent]
    advice = "see the log of the service; restart it unless the slot is replaced within minutes"
    return Check(name="threads", level="bad", found=", ".join(found), advice=advice)


def readings(service: Service) -> Iterator[Reading]:
    """Gauges for a monitor, measured now."""
    counts = {state: float(count) for state, count in service.store.counts().items()}
    yield "needlebench_jobs", "Jobs in the store, by state.", counts
    yield "needlebench_queue_length", "Jobs in the queue.", {"": counts["queued"]}
    oldest = service.store.oldest_queued_at()
    waits_s = 0.0 if oldest is None else max(0.0, service.store.now - oldest)
    yield "needlebench_queue_oldest_seconds", "How long the first job in the queue has waited.", {"": waits_s}
    engine = service.engine
    workers = {
        "slots": engine.slots,
        "alive": engine.alive,
        "silent": len(engine.silent_slots),
        "warm": engine.ready,
        "busy": engine.busy,
    }
    yield (
        "needlebench_workers",
        "Slots for jobs; those with a living thread, with one that has not got on for a minute, warm, busy.",
        {name: float(count) for name, count in workers.items()},
    )
    beats = [job.heartbeat_at for job in service.store.running() if job.heartbeat_at is not None]
    silent_s = max(0.0, service.store.now - min(beats)) if beats else 0.0
    yield "needlebench_heartbeat_age_seconds", "Since the oldest heartbeat of a running job.", {"": silent_s}
    with suppress(OSError):
        free = float(free_bytes(service.settings.data))
        yield "needlebench_disk_free_bytes", "Free space on the disk of the data folder.", {"": free}
        if (files := free_files(service.settings.data)) is not None:
            yield "needlebench_disk_free_files", "Files that its disk has room for (inodes).", {"": float(files)}
