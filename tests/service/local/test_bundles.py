"""Bundles: made of results, refused when one byte is changed, run again elsewhere, honest about what they show."""

from __future__ import annotations

import io
import json
import os
import subprocess
import sys
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from benchmarks.bundles.check import open_bundle
from benchmarks.bundles.verification import read_verification
from benchmarks.cases import Suite
from simcore.rollout.digest import digest
from tests.service.local.bundled import entries, made, needlebench, rewritten, sealed, with_metric

ROOT = Path(__file__).resolve().parents[3]
SAMPLE = ("--sample", "1", "--seed", "2")
Json = dict[str, Any]


@pytest.fixture(scope="module")
def bundle(folder: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("bundle") / "whole.zip"
    made(folder, path, *SAMPLE)
    return path


def test_a_bundle_has_all_that_a_reader_needs(bundle: Path, folder: Path) -> None:
    with open_bundle(bundle) as opened:
        manifest, names = opened.manifest, set(opened.archive.entries)
        suite = Suite("insertions", "", tuple(one.case for one in opened.outcomes))
    (chosen,) = manifest.chosen.cases
    assert names == {
        "manifest.json", "cases.jsonl", "results.csv", f"series/{chosen}.npz", f"recordings/{chosen}.rrd",
    }  # fmt: skip
    assert (manifest.division, manifest.suite.sha256, manifest.suite.cases) == ("closed", suite.sha256, 2)
    assert {arm.controller for arm in manifest.arms} == {"ifem", "open_loop"}
    stored = json.loads((folder / "run 0" / "result.json").read_text())
    (origin,) = manifest.origins
    assert (origin.commit, origin.cpu, origin.cases) == (stored["provenance"]["commit"], stored["provenance"]["cpu"], 2)
    assert manifest.made_with.lock_sha256 is not None
    assert manifest.timing is not None
    told = needlebench("bundle", "check", bundle)
    assert told.exit_code == 0
    assert manifest.id in told.output


def test_the_same_folder_makes_the_same_bytes(bundle: Path, folder: Path, tmp_path: Path) -> None:
    made(folder, tmp_path / "again.zip", *SAMPLE)
    assert (tmp_path / "again.zip").read_bytes() == bundle.read_bytes()
    told = needlebench("bundle", "make", folder, "--out", tmp_path / "again.zip")
    assert (told.exit_code, "exists; use --force" in told.output) == (2, True)


def test_nothing_in_it_names_this_machine(bundle: Path, folder: Path) -> None:
    data = bundle.read_bytes()
    for name in (str(folder), f"{Path.home()}/"):
        assert name.encode() not in data


def test_a_changed_byte_in_any_file_is_refused_with_its_name(bundle: Path, tmp_path: Path) -> None:
    data = bundle.read_bytes()
    for name, (start, size) in entries(bundle).items():
        for place in (start, start + size // 2, start + size - 1):
            changed = bytearray(data)
            changed[place] ^= 1
            (tmp_path / "changed.zip").write_bytes(changed)
            told = needlebench("bundle", "check", tmp_path / "changed.zip")
            assert (told.exit_code, name in told.output) == (2, True), (name, place, told.output)


def test_another_bundle_than_the_one_that_is_meant_is_refused(bundle: Path) -> None:
    with open_bundle(bundle) as opened:
        known = opened.id
    assert needlebench("bundle", "check", bundle, "--id", known[:8]).exit_code == 0
    told = needlebench("bundle", "check", bundle, "--id", known[:7])
    assert (told.exit_code, f"has the id {known}" in told.output) == (2, True)
    assert needlebench("bundle", "verify", bundle, "--id", "0" * 64).exit_code == 2


EMPTY = {"results.csv": b"id\n"}
LIES = {
    "another measure in the table": (None, {"results.csv": b"id\nrun 0\n"}, "results.csv has other insertions"),
    "no number": (with_metric("rmse_commanded_mm", "1"), {}, "rmse_commanded_mm = '1' is not a number"),
    "below zero": (with_metric("rmse_commanded_mm", -1.0), {}, "rmse_commanded_mm = -1.0 is not a number from 0"),
    "another scenario": (lambda line: {**line, "scenario": {**line["scenario"], "seed": 3}}, {}, "is not the suite"),
    "another digest": (lambda line: {**line, "result": {**line["result"], "digest": "0" * 64}}, {}, "not give the dig"),
    "a text for a block": (
        lambda line: {**line, "result": {**line["result"], "timing": "x"}},
        EMPTY,
        "another kind than",
    ),
    "no scenario": (lambda line: {**line, "scenario": {"trajectory": 3}}, EMPTY, "is not the suite"),
    "a file more": (None, {"extra.txt": b"x"}, "extra.txt, which belongs in no bundle"),
}


@pytest.mark.parametrize(("change", "contents", "message"), LIES.values(), ids=LIES)
def test_parts_that_contradict_each_other_are_refused(
    bundle: Path, tmp_path: Path, change: Any, contents: dict[str, bytes], message: str
) -> None:
    lie = rewritten(bundle, tmp_path / "lie.zip", change or (lambda line: line), **contents)
    told = needlebench("bundle", "check", lie)
    assert (told.exit_code, message in told.output) == (2, True), told.output


def test_the_table_must_say_what_the_cases_say(bundle: Path, tmp_path: Path) -> None:
    with open_bundle(bundle) as opened:
        table = opened.archive.read("results.csv", most=10**6).decode()
    changed = table.replace(",completed,", ",not_converged,", 1).encode()
    told = needlebench(
        "bundle", "check", rewritten(bundle, tmp_path / "lie.zip", lambda x: x, **{"results.csv": changed})
    )
    assert "results.csv: run 0: status is 'not_converged', cases.jsonl says 'completed'" in told.output


def test_a_series_that_unpacks_to_more_than_it_says_is_refused(bundle: Path, tmp_path: Path) -> None:
    with open_bundle(bundle) as opened:
        name = f"series/{opened.manifest.chosen.cases[0]}.npz"
    header = io.BytesIO()
    np.lib.format.write_array_header_1_0(header, {"descr": "<f8", "fortran_order": False, "shape": (10**12,)})
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("tip_m.npy", header.getvalue() + bytes(10**6))
    lie = rewritten(bundle, tmp_path / "bomb.zip", lambda line: line, **{name: packed.getvalue()})
    told = needlebench("bundle", "check", lie)
    assert (told.exit_code, "tip_m.npy says that it is larger than it is" in told.output) == (2, True)


# ---- run again


@pytest.mark.slow
def test_what_was_run_here_is_identical_and_the_record_says_so(bundle: Path, tmp_path: Path) -> None:
    record = tmp_path / "record.json"
    told = needlebench("bundle", "verify", bundle, "--sample", "2", "--seed", "5", "--by", "A lab", "--record", record)
    assert told.exit_code == 0, told.output
    assert told.output.count("identical  run ") == 2
    found = read_verification(record)
    with open_bundle(bundle) as opened:
        assert (found.bundle, found.by, found.seed, found.result) == (opened.id, "A lab", 5, "identical")


@pytest.mark.slow
def test_elsewhere_with_nothing_but_the_bundle(bundle: Path, tmp_path: Path) -> None:
    """Another process in an empty folder, with an empty home."""
    (copy := tmp_path / "b.zip").write_bytes(bundle.read_bytes())
    environment = {**os.environ, "HOME": str(tmp_path), "PYTHONPATH": os.pathsep.join([str(ROOT), *sys.path])}
    command = [sys.executable, "-m", "service.cli", "bundle", "verify", copy.name, "--sample", "1", "--seed", "0"]
    told = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False)
    assert (told.returncode, "1 identical" in told.stdout) == (0, True), told.stdout + told.stderr


@pytest.mark.slow
def test_a_measure_that_is_not_what_the_states_give_is_different(bundle: Path, tmp_path: Path) -> None:
    lie = rewritten(bundle, tmp_path / "lie.zip", with_metric("rmse_commanded_mm", 0.001))
    told = needlebench("bundle", "verify", lie, "--sample", "2", "--seed", "1")
    assert told.exit_code == 1
    assert told.output.count("different") == 3
    assert "metrics.rmse_commanded_mm: 0.001 then, " in told.output


@pytest.mark.slow
@pytest.mark.parametrize(("moved_m", "result", "code"), [(5e-10, "equal", 0), (1e-6, "different", 1)])
def test_a_path_that_is_near_enough_is_equal(
    bundle: Path, tmp_path: Path, moved_m: float, result: str, code: int
) -> None:
    """As on another processor: the states differ in their last digits, and so does the digest."""
    with open_bundle(bundle) as opened:
        (case,) = opened.manifest.chosen.cases
        data = opened.archive.read(f"series/{case}.npz", most=10**8)
    with np.load(io.BytesIO(data)) as arrays:
        series = {name: arrays[name] for name in arrays.files}
    series["tip_m"][7] += [moved_m, 0.0, 0.0]
    packed = io.BytesIO()
    np.savez(packed, allow_pickle=False, **series)

    def change(line: Json) -> Json:
        return {**line, "result": {**line["result"], "digest": digest(series)}} if line["id"] == case else line

    near = rewritten(bundle, tmp_path / "near.zip", change, **{f"series/{case}.npz": packed.getvalue()})
    told = needlebench("bundle", "verify", near, "--sample", "2", "--seed", "1")
    assert (told.exit_code, f"{result:<11}{case}" in told.output) == (code, True), told.output
    if result == "different":
        assert "step 7, tip_m: " in told.output


@pytest.mark.slow
def test_without_its_series_a_case_is_judged_by_its_measures(bundle: Path, tmp_path: Path) -> None:
    with open_bundle(bundle) as opened:
        (case,) = opened.manifest.chosen.cases

    def change(line: Json) -> Json:
        return line if line["id"] == case else {**line, "result": {**line["result"], "digest": "0" * 64}}

    told = needlebench("bundle", "verify", rewritten(bundle, tmp_path / "b.zip", change), "--sample", "2")
    assert told.exit_code == 0
    assert ": by its measures; the bundle has no series of it" in told.output


@pytest.mark.slow
def test_another_commit_is_said_before_anything_else(bundle: Path, tmp_path: Path) -> None:
    with open_bundle(bundle) as opened:
        manifest = opened.manifest
        files = {one.name: b"".join(opened.archive.chunks(one.name)) for one in manifest.files}
    other = [manifest.origins[0].model_copy(update={"commit": "f" * 40})]
    told = needlebench("bundle", "verify", sealed(manifest, files, tmp_path / "b.zip", origins=other), "--sample", "1")
    assert f"other code than then, for 2 of 2 cases: commit {'f' * 40} -> " in told.output.splitlines()[1]
