"""A bundle made of insertions that have ended: public names, chosen cases run again, one archive."""

from __future__ import annotations

import json
import shutil
from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from benchmarks.bundles.archive import summed, total_bytes, write_archive
from benchmarks.bundles.canonical import BundleError
from benchmarks.bundles.cases_text import CaseRecord, cases_text, origin_of
from benchmarks.bundles.check import case_table
from benchmarks.bundles.choice import chosen_cases
from benchmarks.bundles.manifest import (
    CASES,
    RECORDINGS,
    RESULTS,
    SCHEMA,
    SERIES,
    ArmRecord,
    Choice,
    FileRecord,
    Maker,
    Manifest,
    Origin,
    SuiteRecord,
    Warned,
)
from benchmarks.bundles.tasks import tasks_sha256
from benchmarks.bundles.zip_format import MANIFEST
from benchmarks.cases import Outcome, Suite
from benchmarks.cautions import cautions
from service.local.bundle_files import BundleFiles, private_lines
from service.local.bundle_runs import ChosenRuns
from service.local.bundle_source import GivenSource, Source, given_controllers, source_of
from service.version import installed_version, lock_sha256
from simcore.arms import PLUGIN, REMOTE, Arm
from simcore.provenance import commit
from simcore.rollout.artefacts import replace_atomically

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from service.local.insertion_sets import InsertionSet

_UNSAID = ("provenance", "cost")  # of a result: said elsewhere in the bundle, or of that moment alone


class Chosen(NamedTuple):
    """How many cases are to be in the bundle with all of their series, and by which seed they are chosen."""

    cases: int
    seed: int


@dataclass
class Draft:
    """A bundle before it is written. contents: of each file, by name, without the manifest."""

    manifest: Manifest
    contents: dict[str, bytes | Path]

    @property
    def bytes(self) -> int:
        """How large the archive will be."""
        return total_bytes({MANIFEST: self.manifest.text(), **self.contents})

    def write(self, path: Path) -> None:
        """Write it as a whole or not at all. Raises BundleError where there is too little space."""
        free = shutil.disk_usage(path.absolute().parent).free
        if free < self.bytes:
            raise BundleError(f"needs {self.bytes / 1e6:.1f} MB at {path}, {free / 1e6:.0f} MB are free")
        replace_atomically(path, lambda file: write_archive(file, {MANIFEST: self.manifest.text(), **self.contents}))


def draft_bundle(
    source: InsertionSet, chosen: Chosen, given: Sequence[GivenSource], say: Callable[[str], None]
) -> Draft:
    """The bundle of insertions that have ended; the chosen ones are run again. Raises BundleError."""
    files = BundleFiles(source)
    outcomes = [files.outcome(outcome) for outcome in source.outcomes]
    arms = _arms(outcomes)
    sources = {arm.id: source_of(arm, given) for arm in arms.values() if arm.kind == PLUGIN}
    runs = ChosenRuns(source, files, say)
    wanted = chosen_cases([one.case.id for one in outcomes], chosen.cases, chosen.seed)
    by_id = {outcome.case.id: outcome for outcome in outcomes}
    with given_controllers(given, arms.values()):
        full = {case_id: found for case_id in wanted if (found := runs.of(by_id[case_id])) is not None}
    records, origins = _records(outcomes, source)
    contents: dict[str, bytes | Path] = {CASES: cases_text(records), RESULTS: case_table(outcomes), **files.contents}
    for one in sources.values():
        contents |= one.contents
    for case_id, (series, recording) in full.items():
        contents[f"{SERIES}/{case_id}.npz"] = series
        if recording is not None:
            contents[f"{RECORDINGS}/{case_id}.rrd"] = recording
    _say_private(contents, say)
    manifest = Manifest(
        schema=SCHEMA,
        division="open" if any(arm.kind == REMOTE for arm in arms.values()) else "closed",
        suite=_suite(source.suite, outcomes),
        arms=_arm_records(arms, records, sources),
        origins=origins,
        made_with=Maker(version=installed_version(), commit=commit(), lock_sha256=lock_sha256()),
        chosen=Choice(seed=chosen.seed, asked=chosen.cases, cases=[one for one in wanted if one in full]),
        timing=runs.timing(outcomes) if full else None,
        warnings=_warnings(outcomes),
        failed=sum(not (outcome.result.get("metrics") or {}).get("stable") for outcome in outcomes),
        named_files=files.listed(),
        renamed=len(files.public.known),
        files=[_file_record(name, contents[name]) for name in sorted(contents)],
    )
    return Draft(manifest, contents)


def _arms(outcomes: Sequence[Outcome]) -> dict[str, Arm]:
    found = dict[str, Arm]()
    for outcome in outcomes:
        if (data := outcome.result["provenance"].get("arm")) is not None:
            arm = Arm.of_data(data)
            found.setdefault(arm.id, arm)
    return found


def _records(outcomes: Sequence[Outcome], source: InsertionSet) -> tuple[list[CaseRecord], list[Origin]]:
    """Each case, and the code and machines that they name by number."""
    origins, counts, records = list[dict[str, Any]](), Counter[int](), list[CaseRecord]()
    for outcome in outcomes:
        case, result = outcome.case, outcome.result
        number, told = None, origin_of(result)
        if told:
            if told not in origins:
                origins.append(told)
            number = origins.index(told)
            counts[number] += 1
        arm = result["provenance"].get("arm")
        records.append(
            CaseRecord(
                id=case.id,
                labels=dict(case.labels),
                scenario=case.scenario,
                result={name: value for name, value in result.items() if name not in _UNSAID},
                arm=None if arm is None else Arm.of_data(arm).id,
                origin=number,
                series_sha256=source.series_sha256(case.id),
            )
        )
    return records, [Origin(cases=counts[i], **one) for i, one in enumerate(origins)]


def _suite(name: str, outcomes: Sequence[Outcome]) -> SuiteRecord:
    suite = Suite(name, "", tuple(outcome.case for outcome in outcomes))
    tasks = tasks_sha256(outcome.case.scenario for outcome in outcomes)
    return SuiteRecord(name=name, sha256=suite.sha256, tasks_sha256=tasks, cases=len(outcomes))


def _arm_records(arms: dict[str, Arm], records: Sequence[CaseRecord], sources: dict[str, Source]) -> list[ArmRecord]:
    counts = Counter(record.arm for record in records)
    found = []
    for arm in arms.values():
        source = sources.get(arm.id)
        data = {**arm.data(), "settings": json.dumps(arm.settings, sort_keys=True)}
        found.append(
            ArmRecord(
                **data,
                cases=counts[arm.id],
                entry_point=None if source is None else source.entry_point,
                source=None if source is None else source.files,
            )
        )
    return found


def _warnings(outcomes: Sequence[Outcome]) -> list[Warned]:
    told = cautions((outcome.case.id, outcome.result.get("warnings") or ()) for outcome in outcomes)
    return [Warned(text=one.text, cases=one.cases, first=list(one.first)) for one in told]


def _file_record(name: str, content: bytes | Path) -> FileRecord:
    size, _, sha256 = summed(content)
    return FileRecord(name=name, bytes=size, sha256=sha256)


def _say_private(contents: dict[str, bytes | Path], say: Callable[[str], None]) -> None:
    """Files that people wrote are taken as they are; that they name a folder of this machine is said."""
    for name, content in contents.items():
        text = content.read_bytes() if isinstance(content, Path) and name.startswith(("files/", "source/")) else b""
        if (line := next(private_lines(text), None)) is not None:
            say(f"warning: {name}, line {line} names a folder of this machine")
