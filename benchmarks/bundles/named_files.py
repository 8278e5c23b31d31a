"""Which files a scenario names: mesh, model, poses, and whatever the settings of a plug-in name."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, NamedTuple

from simcore.arms import PLUGIN

if TYPE_CHECKING:
    from collections.abc import Iterator

    from simcore.arms import Arm

DEFAULT = "default"  # a learned controller's model that comes with needlebench: known by its content alone
_FIELDS = (
    ("tissue", "mesh_file", "mesh_sha256"),
    ("controller", "model", "model_sha256"),
    ("controller", "poses_file", "poses_sha256"),
)


class Named(NamedTuple):
    """A file that a scenario names. field: dotted. name: as it stands there. sha256: of its content."""

    field: str
    name: str
    sha256: str


def named_files(scenario: Mapping[str, Any], arm: Arm | None) -> Iterator[Named]:
    """Every file that a resolved scenario names by a digest of its content, and those of its plug-in's settings."""
    for block, field, digest in _FIELDS:
        known = scenario.get(block) or {}
        name, sha256 = known.get(field), known.get(digest)
        if isinstance(name, str) and isinstance(sha256, str):
            yield Named(f"{block}.{field}", name, sha256)
    if arm is not None and arm.kind == PLUGIN:
        for place, text in _texts(arm.settings):
            if place in arm.files:
                yield Named(f"controller.settings.{place}", text, arm.files[place])


def _texts(value: Any, place: str = "") -> Iterator[tuple[str, str]]:
    """(place, text) of the texts in settings, places as in `Arm.files`."""
    if isinstance(value, Mapping):
        for name, item in value.items():
            yield from _texts(item, f"{place}.{name}" if place else str(name))
    elif isinstance(value, list | tuple):
        for number, item in enumerate(value):
            yield from _texts(item, f"{place}[{number}]")
    elif isinstance(value, str):
        yield place, value
