"""Removes old jobs with their files, uploads that nothing names any more, and folders that belong to no job.

A job's row goes first, then its folder: a kill in between leaves a folder without a job, which the next sweep finds.
"""

from __future__ import annotations

import re
import shutil
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from service.files.disk import size_bytes
from service.store.job import IllegalTransitionError, Job, UnknownJobError
from service.store.jobs import Store
from service.store.uploads import Uploads
from simcore.errors import Problem, ScenarioError

_AGE = re.compile(r"(\d+(?:\.\d+)?)([smhdw])")
_SECONDS = {"s": 1, "m": 60, "h": 3600, "d": 86400, "w": 604800}


@dataclass(frozen=True, kw_only=True)
class Policy:
    """Which jobs that have ended may go; pinned ones never do.

    older_than_s: those that ended longer ago; then also uploads that were sent in longer ago and that no job, campaign,
    schedule or model names which stays. keep_last: never the newest so many; alone, all but these go.
    max_bytes: then the oldest, until the files of the rest hold no more than this. None = no such rule.
    """

    older_than_s: float | None = None
    keep_last: int | None = None
    max_bytes: int | None = None


@dataclass(frozen=True, kw_only=True)
class Cleared:
    """What went, or with a dry run would go. bytes: of files, those of orphans included."""

    jobs: tuple[str, ...]
    orphans: tuple[str, ...]
    bytes: int
    kept: int
    kept_bytes: int
    uploads: tuple[str, ...] = ()


def clear(store: Store, folder: Path, policy: Policy, *, dry_run: bool, uploads: Uploads | None = None) -> Cleared:
    """Apply the policy to the jobs of the store, whose files are in `folder`, and to `uploads`, if they are given;
    orphans go in any case."""
    orphans = _orphans(store, folder)
    ended = store.ended()
    sizes = {job.id: size_bytes(folder / job.id) for job in ended}
    going = _selected(ended, sizes, policy, store.now)
    freed = sum(map(size_bytes, orphans))
    gone = []
    for job in going:
        if not dry_run:
            try:
                store.delete(job.id)
            except (IllegalTransitionError, UnknownJobError):  # retried, pinned or deleted meanwhile
                continue
            remove(folder / job.id)
        gone.append(job.id)
        freed += sizes[job.id]
    if not dry_run:
        for orphan in orphans:
            remove(orphan)
    left = sizes.keys() - set(gone)
    unused = () if uploads is None else uploads.clear(policy.older_than_s, without=set(gone), dry_run=dry_run)
    return Cleared(
        jobs=tuple(gone),
        orphans=tuple(str(orphan.relative_to(folder)) for orphan in orphans),
        uploads=tuple(one.id for one in unused),
        bytes=freed + sum(one.bytes for one in unused),
        kept=len(left),
        kept_bytes=sum(sizes[name] for name in left),
    )


def remove(folder: Path) -> None:
    """Remove a folder as far as it goes: what cannot be removed now is swept later."""
    shutil.rmtree(folder, ignore_errors=True)


def _selected(ended: list[Job], sizes: dict[str, int], policy: Policy, now: float) -> list[Job]:
    """Which of the ended jobs, newest first, go; oldest first."""
    candidates = [job for job in ended[policy.keep_last or 0 :] if not job.pinned]
    going = []
    if policy.older_than_s is not None:
        going = [job for job in candidates if now - (job.finished_at or now) > policy.older_than_s]
    elif policy.keep_last is not None and policy.max_bytes is None:
        going = candidates
    if policy.max_bytes is not None:
        chosen = {job.id for job in going}
        kept_bytes = sum(size for name, size in sizes.items() if name not in chosen)
        for job in reversed(candidates):
            if kept_bytes <= policy.max_bytes:
                break
            if job.id not in chosen:
                going.append(job)
                kept_bytes -= sizes[job.id]
    return sorted(going, key=lambda job: (job.finished_at or 0.0, job.seq))


def _orphans(store: Store, folder: Path) -> list[Path]:
    """Folders of jobs that are not in the store, and of earlier attempts of jobs that have ended.

    The folders are listed before the store is asked: a job that begins meanwhile is in the store by then.
    """
    found = []
    present = sorted(folder.iterdir()) if folder.is_dir() else []
    attempts = {path: [part for part in path.iterdir() if part.name.isdigit()] for path in present if path.is_dir()}
    for path, parts in attempts.items():
        with suppress(UnknownJobError):
            job = store.get_summary(path.name)
            found += [part for part in parts if job.terminal and int(part.name) < job.attempt]
            continue
        found.append(path)
    return found


def seconds_of(text: str, field: str) -> float:
    """'30d' -> 2592000.0; units s, m, h, d, w. Raises ScenarioError."""
    match = _AGE.fullmatch(text.strip())
    if match is None:
        raise ScenarioError([Problem(field, text, "must be a number and a unit: s, m, h, d or w, as in 30d")])
    return float(match[1]) * _SECONDS[match[2]]
