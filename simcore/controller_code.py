"""The code of a controller from another package, as one digest: the files of its distribution, or of a local module."""

from __future__ import annotations

import ast
import functools
import hashlib
import importlib.util
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator
    from importlib.metadata import Distribution, EntryPoint

READ_BYTES = 64_000_000  # a larger file beside the code counts by name and size: a data set, which is not code
COMPILED = (".pyc", ".pyo")


@dataclass(frozen=True)
class Code:
    """version: of the distribution, None of a local module. sha256: over the names and contents of its files, None
    where it has none, as in a notebook's cell."""

    version: str | None
    sha256: str | None


def code_of_entry_point(point: EntryPoint) -> Code:
    """The code behind an entry point. Nothing is imported."""
    return Code(None if point.dist is None else point.dist.version, _digest(files_of_entry_point(point)))


def files_of_entry_point(point: EntryPoint) -> list[tuple[str, Path]]:
    """(name, file) of the code behind an entry point: what its distribution's RECORD lists, if its module is there,
    else the files of the module (as after `pip install --editable`). Nothing is imported."""
    local = dict(module_files(point.module))
    installed = {} if point.dist is None else dict(_recorded_files(point.dist))
    return list((installed if set(local.values()) & set(installed.values()) else local).items())


def code_of_factory(factory: Any) -> Code:
    """The code of what a program registers."""
    return Code(None, _digest(files_of_factory(factory)))


def files_of_factory(factory: Any) -> list[tuple[str, Path]]:
    """(name, file) of the module that defines what a program registers."""
    while isinstance(factory, functools.partial):
        factory = factory.func
    name = getattr(factory, "__module__", None) or type(factory).__module__
    if name == "__main__":
        script = getattr(sys.modules.get(name), "__file__", None)
        return list(_with_siblings(Path(script))) if script else []
    return list(module_files(name))


def files_at(place: Path) -> list[tuple[str, Path]]:
    """(name, file) of the code at a place, as the digests count it: a module with those beside it that it imports, or
    the folder of a package."""
    return list(_of_package(place.resolve()) if place.is_dir() else _with_siblings(place))


def module_files(module: str) -> Iterator[tuple[str, Path]]:
    """(name, file) of everything that belongs to the module's top-level package, or of a lone module with those beside
    it that it imports; none for a module that cannot be found. Nothing is imported."""
    try:
        spec = importlib.util.find_spec(module.partition(".")[0])
    except (ImportError, ValueError):
        return
    if spec is None:
        return
    if spec.submodule_search_locations is None:
        if spec.origin is not None and Path(spec.origin).is_file():
            yield from _with_siblings(Path(spec.origin))
        return
    for folder in map(Path, spec.submodule_search_locations):
        yield from _of_package(folder, spec.name)


def _of_package(folder: Path, name: str | None = None) -> Iterator[tuple[str, Path]]:
    for file in folder.rglob("*"):
        place = file.relative_to(folder)
        if file.is_file() and not _is_byproduct(place):
            yield f"{name or folder.name}/{place.as_posix()}", file.resolve()


def _is_byproduct(place: Path) -> bool:
    return place.suffix in COMPILED or any(part == "__pycache__" or part.startswith(".") for part in place.parts)


def _recorded_files(distribution: Distribution) -> Iterator[tuple[str, Path]]:
    """What RECORD lists, without what the installer adds by itself."""
    for entry in distribution.files or ():
        file = Path(str(distribution.locate_file(entry)))
        if not entry.parts[0].endswith(".dist-info") and not _is_byproduct(Path(*entry.parts)) and file.is_file():
            yield entry.as_posix(), file.resolve()


def _with_siblings(file: Path) -> Iterator[tuple[str, Path]]:
    """A lone module and the modules in its folder that it imports, directly or through each other."""
    waiting, seen = [file.resolve()], set[Path]()
    while waiting:
        one = waiting.pop()
        if one in seen:
            continue
        seen.add(one)
        yield one.name, one
        folder = one.parent
        waiting += [found for name in _imported(one) if (found := folder / f"{name}.py").is_file()]


def _imported(file: Path) -> set[str]:
    """Top-level names that a module imports; none of one that is no Python."""
    try:
        tree = ast.parse(file.read_bytes())
    except (OSError, ValueError, SyntaxError):
        return set()
    names = {alias.name for node in ast.walk(tree) if isinstance(node, ast.Import) for alias in node.names}
    names |= {node.module or "" for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)}
    return {name.partition(".")[0] for name in names if name}


def _digest(files: Iterable[tuple[str, Path]]) -> str | None:
    return digest_of_files((name, file_sha256(file)) for name, file in sorted(files))


def digest_of_files(digests: Iterable[tuple[str, str]]) -> str | None:
    """The digest of code from (name, SHA-256) of each file; None without one."""
    known = sorted(digests)
    if not known:
        return None
    hashed = hashlib.sha256()
    for name, sha256 in known:
        hashed.update(f"{name}\0{sha256}\n".encode())
    return hashed.hexdigest()


def file_sha256(file: Path) -> str:
    """SHA-256 of a file's content; of a very large one of its size. Raises OSError."""
    entry = file.stat()
    return _content_sha256(file, entry.st_size, entry.st_mtime_ns)


@functools.lru_cache(maxsize=4096)
def _content_sha256(file: Path, size: int, changed_ns: int) -> str:
    """size, changed_ns: a file that has either of another value is read again."""
    del changed_ns
    if size > READ_BYTES:
        return f"{size} bytes"
    return hashlib.sha256(file.read_bytes()).hexdigest()
