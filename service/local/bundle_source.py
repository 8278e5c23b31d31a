"""The code of plug-ins in a bundle: what is put in, and how it is run out of one, which only happens when asked for."""

from __future__ import annotations

import importlib
import shutil
import sys
import tempfile
from contextlib import ExitStack, chdir, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from benchmarks.bundles.canonical import BundleError
from benchmarks.bundles.manifest import SOURCE, SourceFile
from benchmarks.bundles.zip_format import check_name
from simcore import plugins
from simcore.controller_code import Code, digest_of_files, file_sha256, files_at
from simcore.errors import Problem, ScenarioError

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping, Sequence

    from benchmarks.bundles.check import Bundle
    from benchmarks.bundles.manifest import ArmRecord
    from simcore.arms import Arm


class GivenSource(NamedTuple):
    """Where the code of a controller that is not installed lies. factory: `module:name` in it."""

    controller: str
    place: Path
    factory: str


def given_source(text: str) -> GivenSource:
    """`mine=mine.py:make` -> the module or package at mine.py, and its factory. Raises ScenarioError."""
    controller, sign, rest = text.partition("=")
    path, colon, name = rest.rpartition(":")
    place = Path(path)
    if not (sign and colon and controller and name.isidentifier()):
        message = "must be NAME=FILE.py:FACTORY or NAME=FOLDER:FACTORY, as in mine=mine.py:make"
        raise ScenarioError([Problem("--source", text, message)])
    if not place.exists():
        raise ScenarioError([Problem("--source", text, f"there is no {place}")])
    return GivenSource(controller, place, f"{place.resolve().stem}:{name}")


class Source(NamedTuple):
    """The code of an arm. files: for the manifest; contents: entry -> file."""

    entry_point: str | None
    files: list[SourceFile]
    contents: dict[str, Path]


def source_of(arm: Arm, given: Sequence[GivenSource]) -> Source:
    """The code of a plug-in, if what is here is what ran. Raises BundleError."""
    told = next((one for one in given if one.controller == arm.controller), None)
    try:
        entry_point, files = (told.factory, files_at(told.place)) if told else plugins.source_of(arm.controller)
    except LookupError:
        advice = f"install it, or say where its code is: --source {arm.controller}=FILE.py:FACTORY"
        raise BundleError(f"controller {arm.controller!r} is not installed here: {advice}") from None
    listed, contents = [], {}
    for name, file in sorted(files):
        sha256 = file_sha256(file)
        entry = _entry(arm, name) if len(sha256) == 64 else None
        listed.append(SourceFile(name=name, sha256=sha256, entry=entry))
        if entry is not None:
            contents[entry] = file
    if digest_of_files((one.name, one.sha256) for one in listed) != arm.code_sha256:
        then = arm.edition or "unknown: it was defined in no file"
        raise BundleError(f"the code of controller {arm.controller!r} here is not the code that ran ({then})")
    return Source(entry_point, listed, contents)


def _entry(arm: Arm, name: str) -> str | None:
    """Where a bundle holds a file of the code; None for what lies outside of the package."""
    entry = f"{SOURCE}/{arm.id}/{name}"
    try:
        check_name(entry)
    except BundleError:
        return None
    return entry


@contextmanager
def given_controllers(given: Sequence[GivenSource], arms: Iterable[Arm]) -> Iterator[None]:
    """While it is open, controllers are those whose code the caller named. Raises BundleError."""
    with ExitStack() as stack:
        for arm in arms:
            for one in given:
                if one.controller == arm.controller:
                    stack.enter_context(_imported(arm, one.factory, one.place.resolve().parent))
        yield


@contextmanager
def running_source(bundle: Bundle, record: ArmRecord, folder: Path) -> Iterator[None]:
    """While it is open, the plug-in of this arm is the one in the bundle: its code is imported, and so executed.

    folder: where it is unpacked. Raises BundleError for code that cannot be imported.
    """
    for one in record.source or ():
        if one.entry is not None:
            bundle.archive.extract(one.entry, folder / one.entry)
    with _imported(record.arm(), record.entry_point or "", folder / SOURCE / record.id):
        yield


@contextmanager
def _imported(arm: Arm, entry_point: str, home: Path) -> Iterator[None]:
    """While it is open, a controller is the factory `module:name` below a folder."""
    module, _, name = entry_point.partition(":")
    if not module or not name:
        raise BundleError(f"the source of controller {arm.controller!r} names no factory")
    _forget(module)
    sys.path.insert(0, str(home))
    try:
        try:
            importlib.invalidate_caches()
            factory = getattr(importlib.import_module(module), name)
        except Exception as error:  # noqa: BLE001  (whatever somebody else's module does)
            reason = f"{type(error).__name__}: {error}"
            raise BundleError(f"the code of controller {arm.controller!r} cannot be imported: {reason}") from None
        with plugins.registered(arm.controller, factory, Code(arm.version, arm.code_sha256)):
            yield
    finally:
        sys.path.remove(str(home))
        _forget(module)


@contextmanager
def files_laid_out(files: Mapping[str, Path]) -> Iterator[None]:
    """While it is open, the current folder is one in which these files have these names: a plug-in opens what its
    settings name by itself."""
    with tempfile.TemporaryDirectory(prefix="needlebench-") as folder:
        for name, file in files.items():
            target = Path(folder) / name
            target.parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(file, target)
        with chdir(folder):
            yield


def _forget(module: str) -> None:
    """What was imported of a package, so that another edition of it can be."""
    top = module.partition(".")[0]
    for known in [one for one in sys.modules if one == top or one.startswith(f"{top}.")]:
        del sys.modules[known]
