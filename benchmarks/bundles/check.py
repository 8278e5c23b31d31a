"""Reads a bundle and refuses it unless all of it is as its manifest says, and its parts say the same."""

from __future__ import annotations

import csv
import hashlib
import io
import math
from collections import Counter
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

from benchmarks.bundles.archive import Archive, open_archive
from benchmarks.bundles.canonical import BundleError
from benchmarks.bundles.cases_text import LONGEST_LINE, CaseRecord, ids_of, read_cases
from benchmarks.bundles.choice import chosen_cases
from benchmarks.bundles.manifest import (
    CASES,
    FILES,
    RECORDINGS,
    RESULTS,
    SERIES,
    SOURCE,
    ArmRecord,
    Manifest,
    read_manifest,
)
from benchmarks.bundles.series_file import digest_of_series
from benchmarks.bundles.tasks import tasks_sha256
from benchmarks.bundles.zip_format import MANIFEST
from benchmarks.cases import Outcome, Suite
from benchmarks.paper.table import insertions_csv, rows
from simcore.arms import PLUGIN, REMOTE
from simcore.controller_code import digest_of_files
from simcore.metrics import MEASURED

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from pathlib import Path

MOST_MANIFEST = 64_000_000  # bytes
MOST_CASES_BYTES, MOST_RESULTS_BYTES = 1_000_000_000, 500_000_000
_SIGNED = ("min_det_f",)  # measures that may be below zero


@dataclass(frozen=True)
class Bundle:
    """A bundle that was checked, open for reading."""

    path: Path
    manifest: Manifest
    records: list[CaseRecord]
    archive: Archive

    @property
    def id(self) -> str:
        """SHA-256 of the manifest."""
        return self.manifest.id

    @cached_property
    def outcomes(self) -> list[Outcome]:
        """As the analyses take them."""
        return [record.outcome(self.manifest) for record in self.records]

    def arm(self, arm_id: str | None) -> ArmRecord | None:
        """An arm by its id."""
        return next((one for one in self.manifest.arms if one.id == arm_id), None)


@contextmanager
def open_bundle(path: Path, *, wanted_id: str | None = None) -> Iterator[Bundle]:
    """The bundle at `path`, every byte of it checked. wanted_id: that it must have, or its first digits.

    Raises BundleError, whose message begins with the path and names the file within that is wrong.
    """
    with _named(path), open_archive(path) as archive:
        manifest = read_manifest(archive.read(MANIFEST, most=MOST_MANIFEST), MANIFEST)
        if wanted_id is not None and not (len(wanted_id) >= 8 and manifest.id.startswith(wanted_id.lower())):
            raise BundleError(f"has the id {manifest.id}, not {wanted_id}")
        _check_files(archive, manifest)
        bundle = Bundle(path, manifest, read_cases(_lines(archive)), archive)
        with _of_the_right_kind():
            _check_suite(bundle)
            _check_arms(bundle)
            _check_results(bundle)
        _check_chosen(bundle)
        yield bundle


@contextmanager
def _of_the_right_kind() -> Iterator[None]:
    """Whatever somebody wrote in place of a number or a block is a refusal, not a crash."""
    try:
        yield
    except BundleError:
        raise
    except (AttributeError, TypeError, LookupError, ValueError, OverflowError, RecursionError) as error:
        reason = f"{type(error).__name__}: {str(error)[:200]}"
        raise BundleError(f"{CASES} has something of another kind than results have ({reason})") from None


@contextmanager
def _named(path: Path) -> Iterator[None]:
    try:
        yield
    except BundleError as error:
        text = str(error)
        raise BundleError(text if text.startswith(f"{path}: ") else f"{path}: {text}") from None


def _lines(archive: Archive) -> Iterator[bytes]:
    if CASES in archive.entries and archive.entries[CASES].size > MOST_CASES_BYTES:
        raise BundleError(f"{CASES} has more than {MOST_CASES_BYTES / 1e9:g} GB")
    return archive.lines(CASES, most=LONGEST_LINE)


def _check_files(archive: Archive, manifest: Manifest) -> None:
    """Every file is one that the manifest lists, with its size and digest; nothing is missing."""
    listed = {file.name: file for file in manifest.files}
    there = [name for name in archive.entries if name != MANIFEST]
    if len(listed) != len(manifest.files):
        raise BundleError(f"{MANIFEST} lists a file twice")
    for name in (CASES, RESULTS, *listed):
        if name not in archive.entries or name not in listed:
            raise BundleError(f"does not hold {name}" if name in listed else f"{MANIFEST} does not list {name}")
    for name in there:
        if name not in listed:
            raise BundleError(f"holds {name}, which {MANIFEST} does not list")
        if name not in (CASES, RESULTS) and name.partition("/")[0] not in (SERIES, RECORDINGS, FILES, SOURCE):
            raise BundleError(f"holds {name}, which belongs in no bundle")
        if archive.entries[name].size != listed[name].bytes or archive.summed(name) != listed[name].sha256:
            raise BundleError(f"{name} was changed: its SHA-256 is not the one in {MANIFEST}")


def _check_suite(bundle: Bundle) -> None:
    """The cases are those of the suite."""
    suite, ids = bundle.manifest.suite, ids_of(bundle.records)
    if len(set(ids)) != len(ids) or len(ids) != suite.cases:
        raise BundleError(f"{CASES} has {len(set(ids))} cases, {MANIFEST} says {suite.cases}")
    found = Suite(suite.name, "", tuple(one.case for one in bundle.outcomes)).sha256
    if found != suite.sha256:
        raise BundleError(f"{CASES} is not the suite that {MANIFEST} says: its SHA-256 is {found[:12]}")
    if tasks_sha256(record.scenario for record in bundle.records) != suite.tasks_sha256:
        raise BundleError(f"{CASES} has other tasks than {MANIFEST} says")


def _check_arms(bundle: Bundle) -> None:
    """Arms are what their digests say; in the closed division all code is within."""
    manifest = bundle.manifest
    counts = Counter(record.arm for record in bundle.records)
    origins = Counter(record.origin for record in bundle.records)
    for arm in manifest.arms:
        if arm.arm().id != arm.id or counts.pop(arm.id, 0) != arm.cases:
            raise BundleError(f"{MANIFEST}: arm {arm.id} is not what its digest or its cases say")
        _check_source(bundle, arm)
    counts.pop(None, None)
    origins.pop(None, None)
    if counts or dict(origins) != {i: one.cases for i, one in enumerate(manifest.origins) if one.cases}:
        raise BundleError(f"{CASES} has arms or origins that {MANIFEST} does not list")
    remote = any(arm.kind == REMOTE for arm in manifest.arms)
    if remote != (manifest.division == "open"):
        raise BundleError(f"{MANIFEST}: division {manifest.division} does not fit its arms")


def _check_source(bundle: Bundle, arm: ArmRecord) -> None:
    if arm.kind != PLUGIN:
        return
    if arm.source is None or digest_of_files((one.name, one.sha256) for one in arm.source) != arm.code_sha256:
        raise BundleError(f"the source of controller {arm.controller!r} is not the code that ran")
    known = {file.name: file.sha256 for file in bundle.manifest.files}
    for one in arm.source:
        if one.entry is not None and known.get(one.entry) != one.sha256:
            raise BundleError(f"{one.entry} is not the file that belongs to the code of controller {arm.controller!r}")


def _check_results(bundle: Bundle) -> None:
    """No measure is below zero or no number, and the table says what the cases say."""
    for record in bundle.records:
        for name in MEASURED:
            value = (record.result.get("metrics") or {}).get(name)
            fits = value is None or (isinstance(value, int | float) and math.isfinite(value))
            if not fits or (value is not None and value < 0.0 and name not in _SIGNED):
                raise BundleError(f"{CASES}: {record.id}: metrics.{name} = {value!r} is not a number from 0")
    stored = _table(bundle.archive.read(RESULTS, most=MOST_RESULTS_BYTES))
    made = _table(insertions_csv(rows(bundle.outcomes)).encode())
    if [line["id"] for line in stored] != [line["id"] for line in made]:
        raise BundleError(f"{RESULTS} has other insertions than {CASES}")
    for line, again in zip(stored, made, strict=True):
        for name in line.keys() & again.keys():
            if line[name] != again[name]:
                raise BundleError(f"{RESULTS}: {line['id']}: {name} is {line[name]!r}, {CASES} says {again[name]!r}")


def _table(text: bytes) -> list[dict[str, Any]]:
    """The lines of a CSV file; columns of another version may be more or fewer."""
    try:
        lines = list(csv.DictReader(io.StringIO(text.decode()), strict=True))
    except (UnicodeDecodeError, csv.Error) as error:
        raise BundleError(f"{RESULTS} cannot be read: {error}") from None
    if any("id" not in line for line in lines):
        raise BundleError(f"{RESULTS} has no column id")
    return lines


def _check_chosen(bundle: Bundle) -> None:
    """The full series are of cases that the seed chose, and give their digests."""
    manifest = bundle.manifest
    chosen = chosen_cases(ids_of(bundle.records), manifest.chosen.asked, manifest.chosen.seed)
    if not set(manifest.chosen.cases) <= set(chosen):
        raise BundleError(f"{MANIFEST}: its series are not of the cases that seed {manifest.chosen.seed} chooses")
    digests = {record.id: record.result.get("digest") for record in bundle.records}
    for file in manifest.files:
        folder, case = file.name.partition("/")[0], manifest.case_of(file.name)
        if folder not in (SERIES, RECORDINGS):
            continue
        if case not in manifest.chosen.cases:
            raise BundleError(f"{file.name} belongs to none of the chosen cases")
        if folder == SERIES and digest_of_series(bundle.archive, file.name) != digests[case]:
            raise BundleError(f"{file.name} does not give the digest of its case")
    if lost := [one for one in manifest.chosen.cases if not manifest.has(f"{SERIES}/{one}.npz")]:
        raise BundleError(f"does not hold the series of {lost[0]}")


def case_table(outcomes: Sequence[Outcome]) -> bytes:
    """The content of results.csv."""
    return insertions_csv(rows(outcomes)).encode()


def sha256_of(text: bytes) -> str:
    """SHA-256 of a text."""
    return hashlib.sha256(text).hexdigest()
