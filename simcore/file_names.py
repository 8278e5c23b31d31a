"""Files that a scenario names. What a name means depends on where the scenario comes from: on the command line it is a
path, over HTTP it is the id of something uploaded, and never a path of the server's disk."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from pathlib import Path

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


def located(field: str, name: str) -> Path:
    """The file that the scenario's `field` names. Raises ScenarioError."""
    try:
        return _lookup.get()(name)
    except NoSuchFileError as error:
        raise ScenarioError([Problem(field, name, str(error))]) from None
