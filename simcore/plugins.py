"""Controllers of other packages: by entry point, or registered by a program for itself."""

from __future__ import annotations

import importlib
import importlib.util
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib.metadata import EntryPoint, entry_points
from typing import TYPE_CHECKING, Any

from simcore.controller_code import (
    Code,
    code_of_entry_point,
    code_of_factory,
    files_of_entry_point,
    files_of_factory,
)
from simcore.errors import ControllerError

if TYPE_CHECKING:
    from pathlib import Path

GROUP = "needlebench.controllers"
Factory = Callable[..., Any]  # (scenario, entry_m, needle_length_m, settings) -> controller
Edition = tuple[str, Code]  # of a controller: module and name, and its code

_registered: dict[str, Factory] = {}
_loaded: dict[str, Code] = {}  # what runs, whatever has become of its files since
_first: dict[str, Edition] = {}  # of each entry point, as this process saw it first


class PluginError(ControllerError):
    """A controller of another package that cannot be loaded, or that answers with something else than a pose."""


def register_controller(name: str, factory: Factory) -> None:
    """Make a controller known in this process as {"kind": "plugin", "name": name}; before an installed one of the
    same name.

    factory: called with (scenario, entry_m (3,) m, needle_length_m, settings), returns a Controller.
    """
    _registered[name] = factory
    _loaded[name] = code_of_factory(factory)


@contextmanager
def registered(name: str, factory: Factory, code: Code) -> Iterator[None]:
    """While it is open, a controller is known as by `register_controller`, with code that is known already."""
    before = _registered.get(name), _loaded.get(name)
    _registered[name], _loaded[name] = factory, code
    try:
        yield
    finally:
        del _registered[name], _loaded[name]
        if before[0] is not None:
            _registered[name] = before[0]
        if before[1] is not None:
            _loaded[name] = before[1]


def installed() -> list[str]:
    """The names of all that can be used, sorted."""
    return sorted({*_registered, *(point.name for point in entry_points(group=GROUP))})


def problem_of(name: str) -> str | None:
    """Why an installed controller cannot be used in this process as it is installed now; None if it can.

    Raises LookupError for an unknown one. Its code is not run.
    """
    if name in _registered:
        return None
    point = _entry_point(name)
    importlib.invalidate_caches()  # it may have been installed a moment ago
    edition = _edition(point)
    if edition is None:
        return (
            f"is installed, but this process cannot find its module {point.module}: if it was installed meanwhile, "
            "restart the service (or the program)"
        )
    if _first.setdefault(name, edition) != edition:
        return "was changed since this process began, which would use the old one: restart the service (or the program)"
    return None


def note_installed() -> None:
    """Remember all that are installed, as they are now: one that is changed later is refused by `problem_of`."""
    for point in entry_points(group=GROUP):
        if (edition := _edition(point)) is not None:
            _first.setdefault(point.name, edition)


def code_of(name: str) -> Code:
    """The code of a controller: as this process has loaded it, else as it is installed now. Raises LookupError for an
    unknown one."""
    if name in _loaded:
        return _loaded[name]
    return code_of_factory(_registered[name]) if name in _registered else code_of_entry_point(_entry_point(name))


def source_of(name: str) -> tuple[str | None, list[tuple[str, Path]]]:
    """(entry point as `module:name`, (name, file) of each file of the code) of a controller as it is now; None in place
    of the entry point of one that a program has registered. Raises LookupError for an unknown one."""
    if name in _registered:
        return None, files_of_factory(_registered[name])
    point = _entry_point(name)
    return point.value, files_of_entry_point(point)


def factory_of(name: str) -> Factory:
    """The factory behind a name. Raises PluginError when it cannot be used or imported, LookupError if unknown."""
    if name in _registered:
        return _registered[name]
    point = _entry_point(name)
    if (problem := problem_of(name)) is not None:
        raise PluginError(f"controller {name!r} ({point.value}) {problem}")
    code = code_of_entry_point(point)  # before its import: what is written later does not run
    try:
        factory: Factory = point.load()
    except Exception as error:
        raise PluginError(f"controller {name!r} ({point.value}) cannot be loaded: {error}") from error
    _loaded.setdefault(name, code)
    return factory


def _entry_point(name: str) -> EntryPoint:
    points: list[EntryPoint] = [point for point in entry_points(group=GROUP) if point.name == name]
    if not points:
        raise LookupError(name)
    return points[0]


def _edition(point: EntryPoint) -> Edition | None:
    """None if its module cannot be found: the package above all, so that nothing is imported for that."""
    try:
        spec = importlib.util.find_spec(point.module.partition(".")[0])
    except (ImportError, ValueError):
        return None
    if spec is None:
        return None
    return (point.value, code_of_entry_point(point))
