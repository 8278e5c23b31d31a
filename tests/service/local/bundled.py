"""Results of short insertions in a folder, bundles of them, and bundles that lie."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

from click.testing import CliRunner, Result

from benchmarks.bundles.archive import write_archive
from benchmarks.bundles.cases_text import CaseRecord, cases_text
from benchmarks.bundles.check import case_table, open_bundle
from benchmarks.bundles.manifest import CASES, RESULTS, FileRecord, Manifest
from benchmarks.bundles.zip_format import MANIFEST
from service.cli.main import main
from simcore.rollout import artefacts
from simcore.rollout.rollout import run
from tests.simcore.short_run import short

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

Json = dict[str, Any]


def needlebench(*words: str | Path) -> Result:
    return CliRunner().invoke(main, [str(word) for word in words], env={"NEEDLEBENCH_URL": None})


def runs_in(folder: Path, *controllers: Json) -> Path:
    """A folder with a run of each controller, named by its number, as `needlebench run` leaves them."""
    for number, controller in enumerate(controllers):
        scenario = short(controller=controller, recording={"enabled": False})
        artefacts.write(run(scenario), folder / f"run {number}")
    return folder


def made(folder: Path, path: Path, *options: str) -> str:
    """The id of the bundle of a folder."""
    told = needlebench("bundle", "make", folder, "--out", path, *options)
    assert told.exit_code == 0, told.output
    return told.stdout.strip()


def rewritten(path: Path, target: Path, change: Callable[[Json], Json], **contents: bytes) -> Path:
    """The bundle with cases changed by `change` (of a line as JSON), and with files replaced: digests and table fit, as
    those of somebody who lies on purpose do."""
    with open_bundle(path) as bundle:
        files = {one.name: b"".join(bundle.archive.chunks(one.name)) for one in bundle.manifest.files}
        records = [CaseRecord(**change(json.loads(record.line()))) for record in bundle.records]
        manifest = bundle.manifest
    if RESULTS not in contents:
        contents[RESULTS] = case_table([record.outcome(manifest) for record in records])
    files |= {CASES: cases_text(records), **contents}
    return sealed(manifest, files, target)


def sealed(manifest: Manifest, files: dict[str, bytes], target: Path, **changes: Any) -> Path:
    """An archive whose manifest has the digests of these files, and changes of its own."""
    from service.local.bundle_making import _file_record

    listed = [FileRecord(**_file_record(name, files[name]).model_dump()) for name in sorted(files)]
    text = manifest.model_copy(update={"files": listed, **changes}).text()
    with target.open("wb") as file:
        write_archive(file, {MANIFEST: text, **files})
    return target


def with_metric(name: str, value: Any) -> Callable[[Json], Json]:
    """Changes a measure of every case."""

    def change(line: Json) -> Json:
        metrics = {**line["result"]["metrics"], name: value}
        return {**line, "result": {**line["result"], "metrics": metrics}}

    return change


def entries(path: Path) -> dict[str, tuple[int, int]]:
    """Name -> (first byte, number of bytes) of each file of a bundle."""
    with open_bundle(path) as bundle:
        return {name: (one.start, one.size) for name, one in bundle.archive.entries.items()}
