"""The chosen cases of a bundle run once more, with recordings: that they give their digests again is a first proof."""

from __future__ import annotations

import json
import time
from contextlib import nullcontext
from typing import TYPE_CHECKING, Any

import numpy as np

from benchmarks.bundles.canonical import BundleError
from benchmarks.bundles.manifest import Timing
from benchmarks.bundles.series_file import without_clocks
from service.local.bundle_source import files_laid_out
from service.local.paper_folder import write_json
from service.local.verify import CannotVerifyError, check_arm, load_series
from simcore.arms import PLUGIN, REMOTE, arm_of
from simcore.errors import NeedlebenchError, ScenarioError
from simcore.file_names import content_in, names_mean
from simcore.provenance import machine
from simcore.rollout.artefacts import replace_atomically
from simcore.rollout.digest import digest

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from contextlib import AbstractContextManager
    from pathlib import Path

    from benchmarks.cases import Outcome
    from service.local.bundle_files import BundleFiles
    from service.local.insertion_sets import InsertionSet
    from simcore.scenario.scenario import Scenario

PASSES = 30  # of L0, the first third thrown away
TIMING = "timing.json"


class ChosenRuns:
    """Full series and recordings of cases, kept in a folder so that a second bundle of the same has the same bytes.

    say: progress, one line.
    """

    def __init__(self, source: InsertionSet, files: BundleFiles, say: Callable[[str], None]) -> None:
        self.source, self.files, self.say = source, files, say
        self.folder = source.kept.absolute()
        self.folder.mkdir(parents=True, exist_ok=True)

    def of(self, outcome: Outcome) -> tuple[Path, Path | None] | None:
        """(series, recording) of a case with public names; None for one that cannot be run again and left no full
        series. Raises BundleError for a case that gives another digest than then."""
        wanted, case_id = outcome.result.get("digest"), outcome.case.id
        if not isinstance(wanted, str):
            return None
        series, recording = self.folder / f"{case_id}.npz", self.folder / f"{case_id}.rrd"
        if _digest(series) != wanted:
            recording.unlink(missing_ok=True)
            if outcome.case.scenario["controller"]["kind"] == REMOTE:
                if not self._copied(case_id, wanted, series):
                    return None
            else:
                self.say(f"running {case_id} again")
                self._run(outcome, wanted, series, recording)
        return series, recording if recording.is_file() else None

    def _copied(self, case_id: str, wanted: str, series: Path) -> bool:
        """The series that the run left, if all of it is there."""
        file = self.source.series_file(case_id)
        if file is None or _digest(file) != wanted:
            return False
        arrays = load_series(file) or {}
        _save(without_clocks(arrays), series)
        return True

    def _run(self, outcome: Outcome, wanted: str, series: Path, recording: Path) -> None:
        from service.recording.observer import RerunObserver
        from simcore.rollout.rollout import run
        from simcore.scenario.scenario import Scenario

        shown = {**outcome.case.scenario, "recording": {**outcome.case.scenario["recording"], "enabled": True}}
        draft = recording.with_name(f".{recording.name}")
        try:
            with names_mean(self.files.lookup), content_in(*self.source.folders), self._place(outcome):
                scenario = Scenario.load(shown)
                check_arm(outcome.result["provenance"], arm_of(scenario.resolved()))
                recorder = RerunObserver(draft, recording_id=wanted[:32])
                with recorder:
                    done = run(scenario, recorder)
            if done.digest != wanted:
                advice = "make the bundle on the machine, and with the commit, that ran it"
                raise BundleError(f"{outcome.case.id} gave another digest when it was run again: {advice}")
            if recorder.warning is None:
                draft.replace(recording)
            else:
                self.say(f"warning: {outcome.case.id}: {recorder.warning}")
            _save(without_clocks(done.series), series)
        except (CannotVerifyError, ScenarioError) as error:
            raise BundleError(f"{outcome.case.id}: {error}") from None
        finally:
            draft.unlink(missing_ok=True)

    def _place(self, outcome: Outcome) -> AbstractContextManager[None]:
        """A plug-in finds the files of its settings in the current folder."""
        plugin = outcome.case.scenario["controller"]["kind"] == PLUGIN
        return files_laid_out(self.files.by_name) if plugin else nullcontext()

    def timing(self, outcomes: Sequence[Outcome]) -> Timing | None:
        """One L0 on this machine, if all of the insertions ran on a processor of its kind and one of them has the
        block's mesh; measured once."""
        here = machine()["cpu"]
        if any((outcome.result.get("provenance") or {}).get("cpu", here) != here for outcome in outcomes):
            return None
        file = self.folder / TIMING
        if file.is_file():
            return Timing.model_validate(json.loads(file.read_bytes()))
        block = next((one for one in outcomes if _has_block(one)), None)
        if block is None:
            return None
        from simcore.scenario.scenario import Scenario

        try:
            scenario = Scenario.load({**block.case.scenario, "controller": {"kind": "open_loop"}})
        except ScenarioError:
            return None
        found = Timing(l0_ms=_l0_ms(scenario), cpu=here)
        write_json(file, found.model_dump())
        return found


def _has_block(outcome: Outcome) -> bool:
    tissue = outcome.case.scenario.get("tissue")
    return isinstance(tissue, dict) and tissue.get("mesh_file") is None


def _l0_ms(scenario: Scenario) -> float:
    from benchmarks.performance.step_clock import limit_of

    limit = limit_of(scenario)
    seconds = [limit.seconds(time.perf_counter) for _ in range(PASSES)]
    return round(1e3 * float(np.median(seconds[PASSES // 3 :])), 4)


def _digest(series: Path) -> str | None:
    """The digest of a series file; None without all of its states."""
    try:
        arrays = load_series(series)
        return None if arrays is None else digest(arrays)
    except (NeedlebenchError, KeyError, IndexError):
        return None


def _save(arrays: dict[str, Any], path: Path) -> None:
    replace_atomically(path, lambda file: np.savez_compressed(file, allow_pickle=False, **arrays))
