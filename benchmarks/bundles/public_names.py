"""Takes paths of a machine out of what a bundle says: they name people, and mean nothing elsewhere."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from pathlib import PurePath, PurePosixPath, PureWindowsPath
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Sequence

ELSEWHERE = "(path)"
_ABSOLUTE = re.compile(
    r"(?<![\w./:~-])(?:~?/[^\s/'\":,;()<>]+(?:/[^\s'\":,;()<>]*)+|[A-Za-z]:[\\/][^\s'\":,;()<>]+|\\\\[^\s'\":,;()<>]+)"
)


def is_private(name: str) -> bool:
    """Whether a name of a file says where it lies on some machine: absolute, from a home, or upwards."""
    parts = PureWindowsPath(name).parts
    absolute = PurePosixPath(name).is_absolute() or PureWindowsPath(name).is_absolute()
    return absolute or name.startswith("~") or ".." in parts or bool(PureWindowsPath(name).drive)


def plain_name(name: str) -> str:
    """The last part of a path, in letters that a file of a bundle may have."""
    last = PureWindowsPath(PurePath(name).name).name
    return re.sub(r"[^\w.,+()@=-]", "-", last).lstrip(".-,=@)") or "file"


@dataclass
class PublicNames:
    """Replaces names of files. folders: whole paths that are to disappear wherever they stand, blanks and all.
    known: private name -> public one."""

    folders: Sequence[str] = ()
    known: dict[str, str] = field(default_factory=dict)

    def name(self, private: str, sha256: str) -> str:
        """The public name of a file: its last part, with some of its digest."""
        stem, dot, suffix = plain_name(private).rpartition(".")
        base, end = (stem, f".{suffix}") if dot else (suffix, "")
        self.known.setdefault(private, f"{base}-{sha256[:8]}{end}")
        return self.known[private]

    def value(self, data: Any) -> Any:
        """The same JSON data without private names."""
        if isinstance(data, str):
            return self.text(data)
        if isinstance(data, dict):
            return {self.text(key): self.value(item) for key, item in data.items()}
        if isinstance(data, list | tuple):
            return [self.value(item) for item in data]
        return data

    def text(self, text: str) -> str:
        """The same text without private names."""
        if text in self.known:
            return self.known[text]
        for private, public in self.known.items():
            text = text.replace(private, public)
        for folder in self.folders:
            text = text.replace(folder, ELSEWHERE)
        return _ABSOLUTE.sub(ELSEWHERE, text)
