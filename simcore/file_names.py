"""Files that a scenario names. What a name means depends on where the scenario comes from: on the command line it is a
path, over HTTP it is the id of something uploaded, and never a path of the server's disk."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from pathlib import Path

from simcore.controller_code import file_sha256
from simcore.errors import NeedlebenchError, Problem, ScenarioError

Lookup = Callable[[str], Path]


class NoSuchFileError(NeedlebenchError, LookupError):
    """A name that stands for no file here; the message says what is wrong with it."""


def nothing(name: str) -> Path:
    """The lookup of a place where scenarios may name no files: refuses every name, and opens nothing."""
    del name
    raise NoSuchFileError("names a file on this machine, which is not accepted here: run it with the command line")


_lookup: ContextVar[Lookup] = ContextVar("lookup", default=Path)


@contextmanager
def names_mean(lookup: Lookup) -> Iterator[None]:
    """Within, the names of files in scenarios are looked up by `lookup`, which raises NoSuchFileError."""
    token = _lookup.set(lookup)
    try:
        yield
    finally:
        _lookup.reset(token)


_folders: ContextVar[tuple[Path, ...]] = ContextVar("folders", default=())


@contextmanager
def content_in(*folders: Path) -> Iterator[None]:
    """Within, a file that is not where it was, but whose digest is known, is looked for in these folders too."""
    token = _folders.set((*folders, *_folders.get()))
    try:
        yield
    finally:
        _folders.reset(token)


def with_content(sha256: str, suffix: str, *more: Path) -> Path | None:
    """The first file with this content and end of its name in `more` or the folders of `content_in`, by name; None if
    there is none."""
    for folder in (*more, *_folders.get()):
        for file in sorted(folder.glob(f"*{suffix}")) if folder.is_dir() else ():
            with suppress(OSError):
                if file.is_file() and file_sha256(file) == sha256:
                    return file
    return None


def located(field: str, name: str) -> Path:
    """The file that the scenario's `field` names. Raises ScenarioError."""
    try:
        return _lookup.get()(name)
    except NoSuchFileError as error:
        raise ScenarioError([Problem(field, name, str(error))]) from None
