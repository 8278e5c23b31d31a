"""Controllers of other packages: by entry point, or registered by a program for itself."""

from __future__ import annotations

from collections.abc import Callable
from importlib.metadata import EntryPoint, entry_points
from typing import Any

from simcore.errors import NeedlebenchError

GROUP = "needlebench.controllers"
Factory = Callable[..., Any]  # (scenario, entry_m, needle_length_m, settings) -> controller

_registered: dict[str, Factory] = {}


class PluginError(NeedlebenchError):
    """A controller of another package that cannot be loaded, or that answers with something else than a pose."""


def register_controller(name: str, factory: Factory) -> None:
    """Make a controller known in this process as {"kind": "plugin", "name": name}; before an installed one of the
    same name.

    factory: called with (scenario, entry_m (3,) m, needle_length_m, settings), returns a Controller.
    """
    _registered[name] = factory


def installed() -> list[str]:
    """The names of all that can be used, sorted."""
    return sorted({*_registered, *(point.name for point in entry_points(group=GROUP))})


def factory_of(name: str) -> Factory:
    """The factory behind a name. Raises PluginError when its package cannot be imported, LookupError if unknown."""
    if name in _registered:
        return _registered[name]
    points: list[EntryPoint] = [point for point in entry_points(group=GROUP) if point.name == name]
    if not points:
        raise LookupError(name)
    try:
        factory: Factory = points[0].load()
    except Exception as error:
        raise PluginError(f"controller {name!r} ({points[0].value}) cannot be loaded: {error}") from error
    return factory
