"""The folder of one experiment, such as a rerun of the paper: every finished insertion is in it at once and for good.

    run.json          what is being run, and by which code: a run goes on only where it began
    results/ID.json   one finished insertion
    series/ID.npz     its time series, without tissue
    dataset.npz       what the controllers were trained on
    models/           the controllers trained in this run
    recordings/       Rerun recordings of chosen cases

A result appears by a rename, after its series: a kill at any moment costs the insertions that were at work.
"""

from __future__ import annotations

import json
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, BinaryIO

from benchmarks.cases import Case, Outcome, RunMany
from service.files.lock import LockHeldError, file_lock
from simcore.errors import Problem, ScenarioError
from simcore.rollout.artefacts import replace_atomically

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence
    from pathlib import Path

RUN, RESULTS, SERIES, MODELS, RECORDINGS = "run.json", "results", "series", "models", "recordings"
FINGERPRINT = ("schema", "scale", "plan_sha256")
FOUNDATION = (
    "element_size_mm",
    "dt_s",
    "training",
    "retraining",
    "samples",
    "nodes",
)  # of a scale: what data set and models rest on


class PaperFolder:
    """An open folder; made by `open_folder`."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.series, self.models, self.recordings = path / SERIES, path / MODELS, path / RECORDINGS

    def finished(self, case: Case) -> Outcome | None:
        """The stored outcome of just this case; None if there is none, or one of another scenario."""
        try:
            stored = json.loads((self.path / RESULTS / f"{case.id}.json").read_bytes())
            same = stored["result"]["provenance"]["scenario"] == case.scenario and stored["labels"] == case.labels
        except FileNotFoundError:
            return None
        except (OSError, ValueError, KeyError, TypeError) as error:
            raise self.refusal(f"holds {RESULTS}/{case.id}.json, which is unreadable: {error}; remove it") from None
        return Outcome(case, stored["result"]) if same else None

    def has_result(self, case_id: str) -> bool:
        """Whether an insertion of this id is stored, unread."""
        return (self.path / RESULTS / f"{case_id}.json").exists()

    def keep(self, outcome: Outcome) -> None:
        """Store an outcome for good."""
        case = outcome.case
        stored = {"id": case.id, "labels": case.labels, "result": outcome.result}
        write_json(self.path / RESULTS / f"{case.id}.json", stored)

    def cached(self, run_many: RunMany) -> RunMany:
        """`run_many` for what is not here yet: finished cases come first, as stored; new ones are stored at once."""

        def run(cases: Sequence[Case]) -> Iterator[Outcome]:
            known = {case.id: self.finished(case) for case in cases}
            yield from (outcome for outcome in known.values() if outcome is not None)
            for outcome in run_many([case for case in cases if known[case.id] is None]):
                self.keep(outcome)
                yield outcome

        return run

    def refusal(self, message: str) -> ScenarioError:
        """The error that says what is wrong with the folder."""
        return ScenarioError([Problem("--out", str(self.path), message)])


@contextmanager
def open_folder(
    path: Path, identity: dict[str, Any], *, any_commit: bool = False, extend: bool | None = False
) -> Iterator[PaperFolder]:
    """The folder for the run `identity`: new, or that of this very run, locked for as long as it is open.

    identity: {"schema", "scale", "plan_sha256", "commit"}. extend: a run of another scale with the same data set and
    models becomes this one, its insertions stay; None: not for this experiment. Raises ScenarioError, with nothing
    changed, for a folder that holds something else, another run or that of another commit, is in use, or cannot be
    written.
    """
    folder = PaperFolder(path)
    _check(folder, identity, any_commit, extend)
    try:
        for part in (RESULTS, SERIES, MODELS, RECORDINGS):
            (path / part).mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise folder.refusal(f"cannot be written: {error.strerror}") from None
    try:
        with file_lock(path / ".lock"):
            if extend or not (path / RUN).exists():
                write_json(path / RUN, identity)
            _sweep(path)
            yield folder
    except LockHeldError as error:
        raise folder.refusal(f"is in use by {error or 'another process'}") from None


def _check(folder: PaperFolder, identity: dict[str, Any], any_commit: bool, extend: bool | None) -> None:
    path = folder.path
    if not path.exists():
        return
    if not path.is_dir():
        raise folder.refusal("is not a folder")
    try:
        begun = json.loads((path / RUN).read_bytes())
    except FileNotFoundError:
        if any(item.name not in (RESULTS, SERIES, MODELS, RECORDINGS, ".lock") for item in path.iterdir()):
            raise folder.refusal("holds files that belong to no run of the paper; choose an empty folder") from None
        return
    except (OSError, ValueError) as error:
        raise folder.refusal(f"holds a {RUN} that is unreadable: {error}") from None
    old, new = begun.get("scale", {}), identity["scale"]
    differing = [key for key in FINGERPRINT if begun.get(key) != identity[key]]
    if extend and begun.get("schema") == identity["schema"]:
        differing = [key for key in FOUNDATION if old.get(key) != new.get(key) and _rests_on(key, old)]
    if differing:
        scale, advice = old.get("name", "unknown"), "choose another folder"
        advice += ", or --extend" if extend is False else ""
        raise folder.refusal(f"holds another run (scale {scale}, {differing[0]} differs); {advice}")
    if begun.get("commit") != identity["commit"] and not any_commit:
        commits = f"{begun.get('commit')} and not {identity['commit']}"
        raise folder.refusal(f"was started by commit {commits}; choose another folder, or continue with --any-commit")


def _rests_on(key: str, scale: dict[str, Any]) -> bool:
    """Whether anything of a run rests on a field of its scale: without a training study nothing was retrained."""
    return key != "retraining" or scale.get(key) != 0


def _sweep(path: Path) -> None:
    """Drafts that a kill left behind."""
    for part in (path, path / RESULTS, path / SERIES, path / MODELS):
        for draft in part.glob(".*.tmp"):
            draft.unlink(missing_ok=True)


def write_json(path: Path, data: Any) -> None:
    """The file as a whole, or as it was."""
    text = json.dumps(data, indent=1, allow_nan=False) + "\n"
    write_text(path, text)


def write_text(path: Path, text: str) -> None:
    """The file as a whole, or as it was."""
    replace_atomically(path, _filling(text))


def _filling(text: str) -> Callable[[BinaryIO], Any]:
    return lambda file: file.write(text.encode())
