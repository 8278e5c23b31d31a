"""Controllers of other packages: by entry point, or registered by a program for itself."""

from __future__ import annotations

import importlib
import importlib.util
from collections.abc import Callable
from importlib.metadata import EntryPoint, entry_points
from typing import Any

from simcore.controller_code import Code, code_of_entry_point, code_of_factory
from simcore.errors import ControllerError

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
