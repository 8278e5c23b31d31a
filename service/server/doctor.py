"""Checks an installation and its data folder without starting anything: what is there, and what to repair."""

from __future__ import annotations

import errno
import os
import platform
import sqlite3
import sys
import tempfile
from dataclasses import replace
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import TYPE_CHECKING

from service.engine.health_checks import Check, Level, disk_check, folder_check
from service.settings import DEFAULT_HOST, DEFAULT_PORT, Settings

if TYPE_CHECKING:
    from collections.abc import Callable

PYTHON = (3, 11)
RERUN = "0.41"  # recordings and viewer must match
PACKAGES = ("numpy", "scipy", "numba", "pydantic", "fastapi", "uvicorn", "sqlalchemy", "alembic", "pebble", "rerun-sdk")
_WORKER_BYTES = 2**30


def examine(settings: Settings) -> list[Check]:
    """Every check, in the order in which a reader wants them."""
    looks: list[Callable[[], Check]] = [
        _python,
        _packages,
        _rerun,
        _kernels,
        _memory,
        lambda: _data(settings),
        lambda: disk_check(_existing(settings.data), settings.minimum_free_bytes),
        lambda: _lock(settings),
        lambda: _database(settings),
        lambda: _port(settings),
        _viewer,
        _pictures,
        lambda: _web_viewer(settings),
        _display,
    ]
    return [_run_check(look) for look in looks]


def _run_check(look: Callable[[], Check]) -> Check:
    """A check that breaks is a finding of its own."""
    try:
        return look()
    except Exception as error:  # noqa: BLE001  (whatever breaks is a finding)
        return Check(name="examination", level="bad", found=f"{type(error).__name__}: {error}", advice="report this")


def _python() -> Check:
    found = f"{platform.python_version()} ({sys.executable})"
    if sys.version_info < PYTHON:
        return Check(name="python", level="bad", found=found, advice=f"install {PYTHON[0]}.{PYTHON[1]} or later")
    return Check(name="python", level="ok", found=found)


def _packages() -> Check:
    versions, missing = [], []
    for package in PACKAGES:
        try:
            versions.append(f"{package} {version(package)}")
        except PackageNotFoundError:
            missing.append(package)
    if missing:
        advice = "pip install --requirement requirements.lock"
        return Check(name="packages", level="bad", found=f"missing: {', '.join(missing)}", advice=advice)
    return Check(name="packages", level="ok", found=", ".join(versions))


def _rerun() -> Check:
    found = version("rerun-sdk")
    if not found.startswith(f"{RERUN}."):
        advice = f"pip install 'rerun-sdk=={RERUN}.*': recordings and viewer must match"
        return Check(name="recordings", level="bad", found=f"rerun-sdk {found}", advice=advice)
    return Check(name="recordings", level="ok", found=f"rerun-sdk {found}")


def _kernels() -> Check:
    """The folder of compiled kernels: writable, and filled for this very source."""
    import simcore.compiled  # noqa: F401  (chooses the folder)

    folder = Path(os.environ["NUMBA_CACHE_DIR"])
    if folder.is_relative_to(tempfile.gettempdir()) and folder.name.startswith("needlebench-kernels-"):
        advice = (
            "every start compiles for about a minute: make the user's cache folder writable, or set NUMBA_CACHE_DIR"
        )
        return Check(name="kernel cache", level="warn", found="no cache folder is writable", advice=advice)
    if next(folder.rglob("*.nbi"), None) is None:
        advice = "the first run compiles for about a minute"
        return Check(name="kernel cache", level="warn", found=f"{folder} is empty", advice=advice)
    return Check(name="kernel cache", level="ok", found=f"{folder} is warm")


def _memory() -> Check:
    try:
        memory = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    except (AttributeError, ValueError, OSError):
        return Check(name="memory", level="ok", found="not known on this platform")
    level: Level = "ok" if memory >= 2 * _WORKER_BYTES else "warn"
    advice = "" if level == "ok" else "run one job at a time: NEEDLEBENCH_WORKERS=1"
    return Check(
        name="memory", level=level, found=f"{memory / 2**30:.1f} GB, {os.cpu_count()} processors", advice=advice
    )


def _existing(folder: Path) -> Path:
    """The folder, or the nearest one above it that exists."""
    return next(path for path in (folder, *folder.parents) if path.exists())


def _data(settings: Settings) -> Check:
    if settings.data.exists():
        check = folder_check(settings.data)
        return replace(check, found=f"{settings.data}: {check.found}")
    nearest = _existing(settings.data)
    if os.access(nearest, os.W_OK):
        return Check(name="data folder", level="ok", found=f"{settings.data} will be made")
    advice = "choose another with --data or NEEDLEBENCH_DATA"
    return Check(name="data folder", level="bad", found=f"{settings.data} cannot be made", advice=advice)


def _lock(settings: Settings) -> Check:
    from service.files.endpoint import endpoint
    from service.files.lock import LockHeldError, file_lock

    path = settings.data / "server.lock"
    if not path.exists():
        return Check(name="service", level="ok", found="none runs on this folder")
    try:
        with file_lock(path):
            return Check(name="service", level="ok", found="none runs on this folder")
    except LockHeldError as busy:
        found = f"{busy or 'a service'} serves this folder at {endpoint(settings.data) or 'an unknown address'}"
        return Check(name="service", level="ok", found=found)


def _database(settings: Settings) -> Check:
    from service.store.database import revision_of, revisions
    from service.store.integrity import DamagedDatabaseError, check_whole
    from service.store.schema import REVISION

    if not settings.database.exists():
        return Check(name="database", level="ok", found="will be made")
    try:
        check_whole(settings.database)
        present = revision_of(settings.database)
    except DamagedDatabaseError as error:
        found, _, advice = str(error).partition(". ")
        return Check(name="database", level="bad", found=found, advice=advice)
    except sqlite3.Error as error:
        advice = "needlebench restore BACKUP puts one of the folder backups beside it in its place"
        return Check(name="database", level="bad", found=f"{settings.database}: {error}", advice=advice)
    if present is not None and present not in revisions():
        advice = "it was written by another version of needlebench: use that version, or choose another folder"
        return Check(
            name="database", level="bad", found=f"tables {present}, this version knows {REVISION}", advice=advice
        )
    if present != REVISION:
        found = f"tables {present or 'none'}, {REVISION} is the newest"
        return Check(name="database", level="warn", found=found, advice="serve copies it to backups, then upgrades it")
    return Check(name="database", level="ok", found=f"tables {present}, the newest")


def _port(settings: Settings) -> Check:
    import socket

    from service.files.endpoint import endpoint

    port = DEFAULT_PORT if settings.port is None else settings.port
    try:
        socket.create_server((DEFAULT_HOST, port)).close()
    except OSError as error:
        if error.errno == errno.EADDRINUSE and (endpoint(settings.data) or "").endswith(f":{port}"):
            return Check(name="port", level="ok", found=f"{port}: the last service of this folder used it")
        advice = "serve takes the next free one unless --port is given"
        return Check(name="port", level="warn", found=f"{port}: {os.strerror(error.errno or 0)}", advice=advice)
    return Check(name="port", level="ok", found=f"{port} is free")


def _viewer() -> Check:
    from service.recording.viewer import ViewerError, program

    try:
        return Check(name="viewer", level="ok", found=program())
    except ViewerError as error:
        return Check(name="viewer", level="bad", found="missing", advice=str(error))


def _pictures() -> Check:
    """Whether a viewer without a window can draw here, tried for real; recordings need it for nothing else."""
    from service.recording.screenshot import NEEDS_DRIVER, try_viewer
    from service.recording.viewer import ViewerError

    try:
        try_viewer()
    except ViewerError as error:
        advice = f"only for view --screenshot. {NEEDS_DRIVER}"
        return Check(name="pictures", level="warn", found=str(error).partition(". ")[0], advice=advice)
    return Check(name="pictures", level="ok", found="the viewer draws without a window")


def _web_viewer(settings: Settings) -> Check:
    """What the pages show recordings with: where it was kept, else as the wheel gives it."""
    from service.recording.viewer import ViewerError
    from service.recording.web_viewer import FILES, PROGRAM, WASM, extracted, viewer_files

    home = extracted(settings.data)
    try:
        files = viewer_files() if home is None else {name: (home / name).read_bytes() for name in FILES}
    except (OSError, ViewerError) as error:
        advice = f"remove {home}: it is made again" if home is not None else "pip install --force-reinstall rerun-sdk"
        return Check(name="web viewer", level="bad", found=str(error), advice=advice)
    where = "in the wheel" if home is None else str(home)
    size = sum(map(len, files.values())) / 1e6
    if not files[PROGRAM].startswith(WASM):
        advice = "pip install --force-reinstall rerun-sdk" if home is None else f"remove {home}: it is made again"
        return Check(name="web viewer", level="bad", found=f"{where}: {PROGRAM} is damaged", advice=advice)
    return Check(name="web viewer", level="ok", found=f"{where}, {size:.0f} MB")


def _display() -> Check:
    if sys.platform == "linux" and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        advice = "only for viewing here: copy recordings elsewhere, or take pictures with view --screenshot"
        return Check(name="display", level="ok", found="none", advice=advice)
    return Check(name="display", level="ok", found="there is one")
