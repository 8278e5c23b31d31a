"""The insertions of an experiment that is over, wherever they are: its results, its series, the files that it names."""

from __future__ import annotations

import hashlib
import json
import re
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

from benchmarks.cases import Case, Outcome
from service.local.campaign_folder import ABOUT, outcome_of, read_about, series_path, stored_lines
from service.local.paper_folder import RESULTS, RUN, SERIES
from simcore.arms import Arm, arm_names
from simcore.errors import Problem, ScenarioError
from simcore.rollout import artefacts

if TYPE_CHECKING:
    from collections.abc import Sequence

    from simcore.file_names import Lookup

KEPT = "bundled"  # folder of the runs that were made for a bundle
_OUTSIDE = re.compile(r"[^\w .,+()-]")


class InsertionSet(Protocol):
    """Insertions that have ended."""

    @property
    def suite(self) -> str:
        """Its name."""

    @property
    def outcomes(self) -> Sequence[Outcome]:
        """In the order of the suite."""

    @property
    def lookup(self) -> Lookup:
        """What names of files in its scenarios mean."""

    @property
    def folders(self) -> Sequence[Path]:
        """Where files are looked for by their content."""

    @property
    def kept(self) -> Path:
        """Where runs that are made again for a bundle may stay."""

    def series_file(self, case_id: str) -> Path | None:
        """The file with the time series of a case, if there is one."""

    def series_sha256(self, case_id: str) -> str | None:
        """SHA-256 of that file."""


@dataclass(frozen=True)
class FolderInsertions:
    """The insertions in a folder of this machine; see `InsertionSet`."""

    suite: str
    outcomes: tuple[Outcome, ...]
    lookup: Lookup
    kept: Path
    files: dict[str, Path] = field(default_factory=dict)  # case id -> its series
    folders: tuple[Path, ...] = ()

    def series_file(self, case_id: str) -> Path | None:
        """The file with the time series of a case, if there is one."""
        file = self.files.get(case_id)
        return file if file is not None and file.is_file() else None

    def series_sha256(self, case_id: str) -> str | None:
        """SHA-256 of that file."""
        file = self.series_file(case_id)
        if file is None:
            return None
        with file.open("rb") as opened:
            return hashlib.file_digest(opened, "sha256").hexdigest()


def insertions_in(folder: Path, *, name: str | None = None) -> FolderInsertions:
    """The insertions of a folder: what `needlebench paper`, `settle` or `campaign run --out` left there, the result of
    `needlebench run`, or a folder of such results. name: of the suite. Raises ScenarioError, which says what is missing
    or unreadable."""
    folder = folder.absolute()
    if (folder / RUN).is_file():
        return _of_experiment(folder, name)
    if (folder / ABOUT).is_file():
        return _of_campaign(folder, name)
    results = [folder / artefacts.RESULT] if (folder / artefacts.RESULT).is_file() else []
    results = results or sorted(folder.glob(f"*/{artefacts.RESULT}"))
    if not results:
        kinds = f"neither {RUN} of an experiment, nor {artefacts.RESULT}, nor folders with one"
        raise ScenarioError([Problem("FOLDER", str(folder), f"holds no insertions: {kinds}")])
    return _of_runs(folder, results, name)


def _of_experiment(folder: Path, name: str | None) -> FolderInsertions:
    about = _read(folder / RUN)
    title = f"{about.get('schema', 'experiment')}, scale {(about.get('scale') or {}).get('name', 'unknown')}"
    outcomes, files = list[Outcome](), dict[str, Path]()
    for path in sorted((folder / RESULTS).glob("*.json")):
        stored = _read(path)
        try:
            scenario = stored["result"]["provenance"]["scenario"]
            outcomes.append(Outcome(Case(stored["id"], scenario, stored["labels"]), stored["result"]))
        except (KeyError, TypeError) as error:
            raise _refusal(path, f"is no finished insertion: {error!r} is missing") from None
        files[stored["id"]] = folder / SERIES / f"{stored['id']}.npz"
    if not outcomes:
        raise _refusal(folder, "holds no finished insertion yet")
    return FolderInsertions(
        name or title, tuple(outcomes), lambda one: folder / one, folder / KEPT, files, (folder / "models", folder)
    )


def _of_campaign(folder: Path, name: str | None) -> FolderInsertions:
    outcomes, files = list[Outcome](), dict[str, Path]()
    for line in stored_lines(folder):
        outcomes.append(outcome_of(line))
        if line["series_sha256"] is not None:
            files[line["id"]] = series_path(folder, line["series_sha256"])
    if not outcomes:
        raise _refusal(folder, "holds no finished insertion yet")
    title = name or str(read_about(folder)["suite"])
    return FolderInsertions(title, tuple(outcomes), Path.cwd().joinpath, folder / KEPT, files, (folder,))


def _of_runs(folder: Path, results: Sequence[Path], name: str | None) -> FolderInsertions:
    known = {path: _result(path) for path in results}
    arms = {path: _arm(result) for path, result in known.items()}
    names = arm_names(arm for arm in arms.values() if arm is not None)
    outcomes, files = list[Outcome](), dict[str, Path]()
    for path, result in known.items():
        scenario, arm = result["provenance"]["scenario"], arms[path]
        title = scenario.get("name", "insertion") if path.parent == folder else path.parent.name
        case_id = _OUTSIDE.sub("-", title).strip(" .-") or "insertion"
        labels = {} if arm is None else {"arm": names[arm.id]}
        outcomes.append(Outcome(Case(case_id, scenario, {**labels}), result))
        files[case_id] = path.with_name(artefacts.SERIES)
    if len(files) < len(outcomes):
        raise _refusal(folder, "holds two results whose names differ in signs alone")
    return FolderInsertions(
        name or "insertions",
        tuple(outcomes),
        Path.cwd().joinpath,
        folder / KEPT,
        files,
        tuple(path.parent for path in results),
    )


def _result(path: Path) -> dict[str, Any]:
    found = _read(path)
    if not isinstance(found.get("digest"), str) or not isinstance(
        (found.get("provenance") or {}).get("scenario"), dict
    ):
        raise _refusal(path, "is no result of needlebench: it has no digest, or no provenance.scenario")
    return found


def _arm(result: dict[str, Any]) -> Arm | None:
    data = result["provenance"].get("arm")
    return None if data is None else Arm.of_data(data)


def _read(path: Path) -> dict[str, Any]:
    try:
        found = json.loads(path.read_bytes())
    except (OSError, ValueError, RecursionError) as error:
        raise _refusal(path, f"is unreadable: {error}") from None
    if not isinstance(found, dict):
        raise _refusal(path, "holds no JSON object")
    return found


def _refusal(path: Path, message: str) -> ScenarioError:
    return ScenarioError([Problem("FOLDER", str(path), message)])
