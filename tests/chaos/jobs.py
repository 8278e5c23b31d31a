"""Real jobs that are short, and what must be true of them whatever was killed."""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING, Any

from service.recording.viewer import ViewerError, check_readable

if TYPE_CHECKING:
    from collections.abc import Iterator

    from needlebench import Client
    from service.client.client import JobStatus

SHORT: dict[str, Any] = {
    "tissue": {"element_size_mm": 10},
    "trajectory": {"kind": "line", "target_mm": [18, 31, 10]},
}


def scenario(number: int) -> dict[str, Any]:
    """One of a few scenarios that differ in their results."""
    return {**SHORT, "name": f"chaos {number}", "seed": number % 3, "noise_mm": 0.1}


def works_on(pid: int) -> tuple[str, int] | None:
    """Job and attempt of a worker, by the files that it holds open (Linux)."""
    try:
        for link in Path(f"/proc/{pid}/fd").iterdir():
            parts = link.readlink().parts
            if parts[-1] == "job.log":
                return parts[-3], int(parts[-2])
    except OSError:
        return None
    return None


def crashes(client: Client, job: JobStatus) -> int:
    """How many of the job's attempts ended with a death; its log must be that of one life."""
    kinds = Counter(event["kind"] for event in log_of(client, job.id))
    assert kinds["queued"] == 1
    assert kinds["finished"] == 1, (job.id, kinds)
    assert kinds["started"] == job.attempt == 1 + kinds["crashed"] + kinds["requeued"], (job.id, kinds)
    return kinds["crashed"]


def log_of(client: Client, job_id: str) -> list[dict[str, Any]]:
    return list(client._json("GET", f"/api/v1/jobs/{job_id}/events")["items"])


def recordings(data: Path) -> Iterator[Path]:
    """Every recording in the data folder, those of killed attempts included."""
    yield from sorted((data / "jobs").glob("*/*/recording.rrd"))


def check_recordings(data: Path, finished: set[tuple[str, int]]) -> Counter[str]:
    """Each can be read; one whose worker was killed before its first block may be empty. How many of which kind."""
    found: Counter[str] = Counter()
    for path in recordings(data):
        whole = (path.parts[-3], int(path.parts[-2])) in finished
        if not whole and path.stat().st_size == 0:
            found["empty"] += 1
            continue
        try:
            check_readable(path)
        except ViewerError as error:
            if not whole and str(error).endswith("holds no recording"):  # its layout was written, and no block yet
                found["empty"] += 1
                continue
            raise AssertionError(f"{path}, whole={whole}: {error}") from None
        found["whole" if whole else "cut short"] += 1
    return found


def check_digests(jobs: list[JobStatus]) -> int:
    """Jobs of the same seed have the same digest, killed in between or not; how many different ones there are."""
    digests: dict[int, set[str]] = {}
    for job in jobs:
        assert job.result is not None
        assert job.scenario is not None
        digests.setdefault(job.scenario["seed"], set()).add(job.result["digest"])
    assert all(len(found) == 1 for found in digests.values()), digests
    return len(digests)
