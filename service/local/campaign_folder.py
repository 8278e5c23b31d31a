"""The folder of a campaign that runs without a service: every finished insertion is in it at once and for good.

    campaign.json        what is being run, and by which code: a campaign goes on only where it began
    outcomes.jsonl       a line for each finished insertion, in the order in which they ended
    series/AB/SHA256.npz its time series, named by its content
    campaign.parquet     one table of all, written when all have ended

A line is written after its series. What a kill or a power cut leaves of the last line is taken off and run again.
"""

from __future__ import annotations

import hashlib
import json
import os
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from benchmarks.cases import Case, Outcome
from service.files.lock import LockHeldError, file_lock
from service.local.paper_folder import write_json
from simcore.errors import Problem, ScenarioError
from simcore.provenance import commit

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path
    from typing import BinaryIO

    from benchmarks.cases import Suite

SCHEMA = "needlebench/campaign-folder/1"
ABOUT, OUTCOMES, SERIES, TABLE, INCOMING = "campaign.json", "outcomes.jsonl", "series", "campaign.parquet", "incoming"


class CampaignFolder:
    """An open folder; made by `open_campaign_folder`. finished: the ids of the insertions in it."""

    def __init__(self, path: Path, lines: BinaryIO, finished: set[str]) -> None:
        self.path, self._lines, self.finished = path, lines, finished
        self.incoming = path / INCOMING

    def keep(self, outcome: Outcome) -> None:
        """Store an outcome for good, with the series that its worker left in `incoming`. One is kept once."""
        case = outcome.case
        if case.id in self.finished:
            return
        left = self.incoming / f"{case.id}.npz"
        sha256 = _moved_by_content(left, self.path / SERIES) if left.is_file() else None
        line = {"id": case.id, "labels": case.labels, "series_sha256": sha256, "result": outcome.result}
        self._lines.write(json.dumps(line, allow_nan=False).encode() + b"\n")
        self._lines.flush()
        self.finished.add(case.id)


def stored_lines(path: Path) -> Iterator[dict[str, Any]]:
    """What a folder has of each finished insertion: id, labels, series_sha256, result. Raises ScenarioError."""
    with (path / OUTCOMES).open("rb") as file:
        for number, line in enumerate(file, 1):
            if not line.endswith(b"\n"):
                return
            try:
                yield json.loads(line)
            except ValueError as error:
                raise _refusal(path, f"holds {OUTCOMES}, whose line {number} is unreadable: {error}") from None


def outcome_of(line: dict[str, Any]) -> Outcome:
    """The outcome that a line holds."""
    return Outcome(Case(line["id"], line["result"]["provenance"]["scenario"], line["labels"]), line["result"])


def series_path(path: Path, sha256: str) -> Path:
    """Where a folder has the series of that content."""
    return path / SERIES / sha256[:2] / f"{sha256}.npz"


def read_about(path: Path) -> dict[str, Any]:
    """What a folder runs. Raises ScenarioError."""
    try:
        about: dict[str, Any] = json.loads((path / ABOUT).read_bytes())
    except (OSError, ValueError) as error:
        raise _refusal(path, f"holds a {ABOUT} that is unreadable: {error}") from None
    return about


@contextmanager
def open_campaign_folder(
    path: Path, suite: Suite, request: dict[str, Any], *, any_commit: bool = False
) -> Iterator[CampaignFolder]:
    """The folder of a campaign: new, or that of this very one, locked for as long as it is open.

    Raises ScenarioError, with nothing changed, for a folder that holds something else, another campaign or that of
    another commit, is in use, or cannot be written.
    """
    about = {
        "schema": SCHEMA,
        "name": request.get("name") or suite.name,
        "suite": suite.name,
        "suite_sha256": suite.sha256,
        "cases": len(suite.cases),
        "commit": commit(),
        "request": request,
    }
    _check(path, about, any_commit)
    try:
        (path / INCOMING).mkdir(parents=True, exist_ok=True)
        with file_lock(path / ".lock"):
            if not (path / ABOUT).exists():
                write_json(path / ABOUT, about)
            finished = _mended(path)
            with (path / OUTCOMES).open("ab") as lines:
                yield CampaignFolder(path, lines, finished)
                os.fsync(lines.fileno())
    except LockHeldError as error:
        raise _refusal(path, f"is in use by {error or 'another process'}") from None
    except PermissionError as error:
        raise _refusal(path, f"cannot be written: {error.strerror}") from None


def _check(path: Path, about: dict[str, Any], any_commit: bool) -> None:
    if not path.exists():
        return
    if not path.is_dir():
        raise _refusal(path, "is not a folder")
    if not (path / ABOUT).exists():
        if any(item.name not in (INCOMING, ".lock") for item in path.iterdir()):
            raise _refusal(path, "holds files that belong to no campaign; choose an empty folder")
        return
    begun = read_about(path)
    for field in ("schema", "suite_sha256"):
        if begun.get(field) != about[field]:
            raise _refusal(
                path, f"holds another campaign ({begun.get('name')}, {field} differs); choose another folder"
            )
    if begun.get("commit") != about["commit"] and not any_commit:
        commits = f"{begun.get('commit')} and not {about['commit']}"
        raise _refusal(path, f"was started by commit {commits}; choose another folder, or continue with --any-commit")


def _mended(path: Path) -> set[str]:
    """The ids of the finished insertions, after taking off half a line at the end."""
    file = path / OUTCOMES
    file.touch()
    finished = {line["id"] for line in stored_lines(path)}
    with file.open("rb+") as lines:
        content_end = lines.seek(0, os.SEEK_END)
        while content_end and (lines.seek(content_end - 1), lines.read(1))[1] != b"\n":
            content_end -= 1
        lines.truncate(content_end)
    return finished


def _moved_by_content(file: Path, folder: Path) -> str:
    with file.open("rb") as opened:
        sha256 = hashlib.file_digest(opened, "sha256").hexdigest()
    (folder / sha256[:2]).mkdir(parents=True, exist_ok=True)
    file.replace(folder / sha256[:2] / f"{sha256}.npz")
    return sha256


def _refusal(path: Path, message: str) -> ScenarioError:
    return ScenarioError([Problem("--out", str(path), message)])
