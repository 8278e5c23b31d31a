"""What the service can be told, by flag or by environment variable; checked once, at construction."""

from __future__ import annotations

import ipaddress
import os
import secrets
import shlex
import sys
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from platformdirs import user_data_path

from service.api_key import keys_exist
from service.files.disk import MINIMUM_BYTES
from service.limits import Limits, SettingsError
from simcore.errors import Problem

__all__ = ["Limits", "Settings", "SettingsError", "data_dir", "is_loopback", "url_of"]

DEFAULT_HOST = "127.0.0.1"
DEFAULT_PORT = 8321
MAXIMUM_WORKERS = 2
RUNNER = "service.worker.attempt:run_job"


def default_data_dir() -> Path:
    """Where jobs, results and recordings live when nothing else is said, by the custom of the platform."""
    return user_data_path("needlebench", appauthor=False)


def data_dir(environ: Mapping[str, str] = os.environ) -> Path:
    """The data folder by environment variable or default."""
    named = environ.get("NEEDLEBENCH_DATA")
    return (Path(named) if named else default_data_dir()).expanduser().absolute()


def is_loopback(host: str) -> bool:
    """Whether only this machine can reach `host`. A name other than localhost counts as reachable from outside."""
    if host == "localhost":
        return True
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False


def url_of(host: str, port: int) -> str:
    """The address to type into a browser on this machine."""
    shown = {"0.0.0.0": "127.0.0.1", "::": "::1"}.get(host, host)
    return f"http://[{shown}]:{port}" if ":" in shown else f"http://{shown}:{port}"


@dataclass(frozen=True, kw_only=True)
class Settings:
    """Everything that the service can be told.

    data: folder of the database, the results and the recordings. port: None = the default one or the next free.
    minimum_free_bytes: room on the disk below which no job is begun.
    drain_s: how long running jobs may go on once the service was told to end; then they go back into the queue.
    keep_days, keep_gb: once a day jobs that ended longer ago go, then the oldest until the rest fits; None = no rule.
    runner: `module:function` that does a job in a worker process; tests replace it.
    """

    data: Path = field(default_factory=default_data_dir)
    host: str = DEFAULT_HOST
    port: int | None = None
    workers: int = MAXIMUM_WORKERS
    api_key: str | None = field(default=None, repr=False)
    minimum_free_bytes: int = MINIMUM_BYTES
    drain_s: float = 0.0
    keep_days: float | None = None
    keep_gb: float | None = None
    limits: Limits = field(default_factory=Limits)
    runner: str = RUNNER

    def __post_init__(self) -> None:
        problems = []
        if not 1 <= self.workers <= MAXIMUM_WORKERS:
            problems.append(Problem("NEEDLEBENCH_WORKERS", self.workers, f"must be 1 to {MAXIMUM_WORKERS}"))
        if self.port is not None and not 0 <= self.port <= 65535:
            problems.append(Problem("--port", self.port, "must be 0 (any free port) to 65535"))
        if self.minimum_free_bytes < 0:
            value = self.minimum_free_bytes // 2**20
            problems.append(Problem("NEEDLEBENCH_MINIMUM_FREE_MB", value, "must be 0 or more"))
        if not 0 <= self.drain_s <= 86400:
            problems.append(Problem("--drain", self.drain_s, "must be 0 to 86400 s"))
        problems.extend(_keep_problem("NEEDLEBENCH_KEEP_DAYS", self.keep_days, least=1, most=36_500))
        problems.extend(_keep_problem("NEEDLEBENCH_KEEP_GB", self.keep_gb, least=0, most=1e6))
        if not self.host:
            problems.append(Problem("--host", self.host, "must be an address, as in 127.0.0.1"))
        problems.extend(self._key_problems())
        if problems:
            raise SettingsError(problems)

    def _key_problems(self) -> list[Problem]:
        if self.api_key is None:
            if is_loopback(self.host) or keys_exist(self.database):
                return []
            return [Problem("--host", self.host, _refusal(self.host, self.port))]
        if self.api_key and self.api_key.isascii() and self.api_key.isprintable() and " " not in self.api_key:
            return []
        return [Problem("NEEDLEBENCH_API_KEY", "(hidden)", "must be printable ASCII characters without spaces")]

    @property
    def loopback(self) -> bool:
        """Whether only this machine can reach the service."""
        return is_loopback(self.host)

    @property
    def database(self) -> Path:
        return self.data / "needlebench.sqlite"

    @property
    def jobs(self) -> Path:
        """Folder of the artefacts, one folder a job and in it one an attempt."""
        return self.data / "jobs"

    @property
    def uploads(self) -> Path:
        """Folder of the files that were sent in, each named by its content."""
        return self.data / "uploads"

    @classmethod
    def load(
        cls,
        *,
        data: Path | None = None,
        host: str | None = None,
        port: int | None = None,
        drain_s: float = 0.0,
        keep_days: float | None = None,
        keep_gb: float | None = None,
        environ: Mapping[str, str] = os.environ,
    ) -> Settings:
        """Flags first, then environment variables, then defaults. Raises SettingsError."""
        return cls(
            data=data_dir(environ) if data is None else data.expanduser().absolute(),
            host=host or environ.get("NEEDLEBENCH_HOST") or DEFAULT_HOST,
            port=port if port is not None else _whole(environ, "NEEDLEBENCH_PORT", None),
            workers=_whole(environ, "NEEDLEBENCH_WORKERS", MAXIMUM_WORKERS) or 0,
            api_key=environ.get("NEEDLEBENCH_API_KEY") or None,
            minimum_free_bytes=(_whole(environ, "NEEDLEBENCH_MINIMUM_FREE_MB", MINIMUM_BYTES // 2**20) or 0) * 2**20,
            drain_s=drain_s,
            keep_days=_number(environ, "NEEDLEBENCH_KEEP_DAYS") if keep_days is None else keep_days,
            keep_gb=_number(environ, "NEEDLEBENCH_KEEP_GB") if keep_gb is None else keep_gb,
            limits=Limits.load(environ),
        )


def variables_help() -> list[tuple[str, str]]:
    """The environment variables and what they set; those of limits are in `limits.limits_help`."""
    return [
        ("NEEDLEBENCH_DATA", "folder of jobs, results, recordings and uploads; as --data"),
        ("NEEDLEBENCH_HOST", "address to listen on; as --host"),
        ("NEEDLEBENCH_PORT", "port to listen on; as --port"),
        ("NEEDLEBENCH_WORKERS", f"jobs at a time, 1 to {MAXIMUM_WORKERS}; default {MAXIMUM_WORKERS}"),
        ("NEEDLEBENCH_MINIMUM_FREE_MB", f"room below which no job is begun; default {MINIMUM_BYTES // 2**20}"),
        ("NEEDLEBENCH_KEEP_DAYS", "days after which ended jobs are cleared away; as --keep-days"),
        ("NEEDLEBENCH_KEEP_GB", "size above which the oldest ended jobs are; as --keep-gb"),
        ("NEEDLEBENCH_API_KEY", "a key of scope admin, beside those of `needlebench key`"),
    ]


def _whole(environ: Mapping[str, str], name: str, default: int | None) -> int | None:
    text = environ.get(name, "").strip()
    if not text:
        return default
    try:
        return int(text)
    except ValueError:
        raise SettingsError([Problem(name, text, "must be a whole number")]) from None


def _keep_problem(name: str, value: float | None, *, least: float, most: float) -> list[Problem]:
    if value is None or least <= value <= most:
        return []
    return [Problem(name, value, f"must be {least:g} to {most:.0f}")]


def _number(environ: Mapping[str, str], name: str) -> float | None:
    text = environ.get(name, "").strip()
    try:
        return float(text) if text else None
    except ValueError:
        raise SettingsError([Problem(name, text, "must be a number")]) from None


def _refusal(host: str, port: int | None) -> str:
    """The line that makes a bind to an address other than loopback acceptable, with a fresh key."""
    key = secrets.token_urlsafe(24)
    command = f"needlebench serve --host {shlex.quote(host)}" + (f" --port {port}" if port is not None else "")
    line = (
        f"$env:NEEDLEBENCH_API_KEY='{key}'; {command}"
        if sys.platform == "win32"
        else f"NEEDLEBENCH_API_KEY={key} {command}"
    )
    return (
        f"anyone who reaches this address could run jobs, so it needs a key. Type:\n\n    {line}\n\n"
        "or make keys that are kept, one for each who may: needlebench key create --scope admin\n"
    )
