"""A leaderboard's folder: pages, all figures as JSON, the bundles themselves and their recordings."""

from __future__ import annotations

import json
import shutil
import tempfile
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING

from benchmarks.bundles.canonical import BundleError
from benchmarks.bundles.check import Bundle, open_bundle
from benchmarks.bundles.verification import Verification, read_verification, record_of
from benchmarks.leaderboard.boards import Entry, bundle_file, document, recording_file
from benchmarks.leaderboard.pages import pages
from simcore.errors import Problem, ScenarioError

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

FIGURES = "leaderboard.json"


def write_site(
    files: Sequence[Path], out: Path, *, title: str, replace: bool, say: Callable[[str], None]
) -> list[Entry]:
    """Write the site of some bundles to `out`, as a whole or not at all; records of verifications may be among the
    files, and those beside the bundles are found. Returns the bundles. Raises BundleError, ScenarioError."""
    _check_target(out, replace=replace)
    out.absolute().parent.mkdir(parents=True, exist_ok=True)
    draft = Path(tempfile.mkdtemp(prefix=f".{out.name}-", dir=out.absolute().parent))
    try:
        entries = _fill(files, draft, say)
        figures = document(entries)
        (draft / FIGURES).write_text(json.dumps(figures, indent=1, allow_nan=False) + "\n", encoding="utf-8")
        for name, text in pages(figures, title=title):
            (draft / name).write_text(text, encoding="utf-8", newline="\n")
        draft.chmod(0o755)
        if out.exists():
            shutil.rmtree(out)
        draft.replace(out)
    finally:
        shutil.rmtree(draft, ignore_errors=True)
    return entries


def _check_target(out: Path, *, replace: bool) -> None:
    """Only an empty folder is filled, and with `replace` a leaderboard's."""
    if not out.exists():
        return
    if not out.is_dir():
        raise ScenarioError([Problem("--out", str(out), "is not a folder")])
    if not any(out.iterdir()):
        return
    if not (out / FIGURES).is_file():
        raise ScenarioError([Problem("--out", str(out), "holds something else than a leaderboard; name a new folder")])
    if not replace:
        raise ScenarioError([Problem("--out", str(out), "holds a leaderboard; use --force to replace it")])


def _fill(files: Sequence[Path], draft: Path, say: Callable[[str], None]) -> list[Entry]:
    """Copy bundles and recordings; what each bundle says."""
    known = dict[str, list[Verification]]()
    bundles = [path for path in files if path.suffix != ".json"]
    records = [path for path in files if path.suffix == ".json"]
    records += [found for path in bundles if (found := record_of(path)).is_file() and found not in records]
    for path in records:
        verification = read_verification(path)
        known.setdefault(verification.bundle, []).append(verification)
    entries, seen = list[Entry](), dict[str, Path]()
    for path in bundles:
        with ExitStack() as stack:
            bundle = stack.enter_context(open_bundle(path))
            if bundle.id in seen:
                raise BundleError(f"{path}: is the same bundle as {seen[bundle.id]}")
            seen[bundle.id] = path
            told = tuple(sorted(known.pop(bundle.id, []), key=lambda one: one.at))
            entry = Entry(bundle.manifest, bundle.outcomes, told)
            _copy(bundle, entry, draft)
            entries.append(entry)
            say(f"{path}: {bundle.manifest.suite.name}, {bundle.manifest.suite.cases} cases")
    for bundle_id in known:
        say(f"warning: a verification is of bundle {bundle_id[:12]}, which is not among these")
    return entries


def _copy(bundle: Bundle, entry: Entry, draft: Path) -> None:
    target = draft / bundle_file(bundle.id)
    target.parent.mkdir(exist_ok=True)
    shutil.copyfile(bundle.path, target)
    for number, name in enumerate(entry.recordings.values()):
        bundle.archive.extract(name, draft / recording_file(bundle.id, number))
