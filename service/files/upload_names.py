"""How scenarios name uploaded files: `artefact:<id>`. Workers know this much and no database."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Any

from simcore.file_names import NoSuchFileError

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

SCHEME = "artefact:"
SUFFIXES = {
    "mesh": (".msh", ".vtu", ".vtk", ".mesh", ".inp"),
    "model": (".json",),
    "dataset": (".npz",),
    "poses": (".npy",),
}
NAMES = {"mesh": "mesh", "model": "model", "dataset": "data set", "poses": "list of poses"}  # in sentences
UPLOAD_ID = r"[0-9a-f]{64}\.[a-z]{1,8}"
_REFERENCE = re.compile(f"{SCHEME}({UPLOAD_ID})")
NAME = r"[A-Za-z0-9_][A-Za-z0-9_ .+()-]{0,99}"


class UploadLookup:
    """What file names in scenarios mean to the service: `artefact:<id>`, nothing else. `used` collects the ids."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self.used: set[str] = set()

    def __call__(self, name: str) -> Path:
        """The file. Raises NoSuchFileError; a name that is no id is not looked at any further."""
        upload_id = name.removeprefix(SCHEME)
        if not name.startswith(SCHEME) or not re.fullmatch(UPLOAD_ID, upload_id):
            raise NoSuchFileError(
                "names a file on this machine, which is not accepted here: send the file with `needlebench upload` "
                f"and write {SCHEME}ID"
            )
        path = self._folder / upload_id
        if not path.is_file():
            message = "is no upload of this service, or was deleted: send the file with `needlebench upload`"
            raise NoSuchFileError(message)
        self.used.add(upload_id)
        return path


def references(value: Any, field: str = "") -> Iterator[tuple[str, str]]:
    """(field, id of the upload) of each that the JSON data names, fields written as in tissue.mesh_file."""
    if isinstance(value, str):
        if (match := _REFERENCE.fullmatch(value)) is not None:
            yield field, match[1]
    elif isinstance(value, dict):
        for name, item in value.items():
            yield from references(item, f"{field}.{name}" if field else str(name))
    elif isinstance(value, list | tuple):
        for number, item in enumerate(value):
            yield from references(item, f"{field}[{number}]")
