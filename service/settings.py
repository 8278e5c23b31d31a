"""The settings of the service, by flag or environment variable; checked once, at construction."""

from __future__ import annotations

import os
import secrets
import shlex
import sys
from pathlib import Path
from typing import Self
from urllib.parse import urlsplit

from platformdirs import user_data_path
from pydantic import Field, field_validator

from service.api_key import keys_exist
from service.environment import Section, SettingsError, note_of, setting, variables_of
from service.files.disk import MINIMUM_BYTES
from simcore.errors import Problem
from simcore.remote.link import is_loopback

DEFAULT_HOST = "127.0.0.1"
DEFAULT_PORT = 8321
MAXIMUM_WORKERS = 2
_OWN_PATHS = (
    "api campaigns compare healthz jobs login logout metrics models openapi.json readyz recordings schedules static "
    "submit trends version viewer"
)
RUNNER = "service.worker.attempt:run_job"


def default_data_dir() -> Path:
    """Where jobs, results and recordings are kept unless another folder is named: the platform's data folder."""
    return user_data_path("needlebench", appauthor=False)


def data_dir() -> Path:
    """The data folder by environment variable or default."""
    named = os.environ.get("NEEDLEBENCH_DATA")
    return (Path(named) if named else default_data_dir()).expanduser().absolute()


def url_of(host: str, port: int) -> str:
    """The address to type into a browser on this machine."""
    shown = {"0.0.0.0": "127.0.0.1", "::": "::1"}.get(host, host)
    return f"http://[{shown}]:{port}" if ":" in shown else f"http://{shown}:{port}"


class Limits(Section):
    """What is refused, and from where on; all defaults [ours]. 1 MB = 10^6 bytes."""

    body_mb: float = setting(
        1, "NEEDLEBENCH_MAX_BODY_MB", "MB of a request's body, uploads apart", low=0.001, high=1000
    )
    upload_mb: float = setting(64, "NEEDLEBENCH_MAX_UPLOAD_MB", "MB of an uploaded file", low=0.001, high=200)
    uploads_mb: float = setting(
        2000, "NEEDLEBENCH_MAX_UPLOADS_MB", "MB of all uploaded files together", low=0.001, high=1e9
    )
    queue: int = setting(10_000, "NEEDLEBENCH_MAX_QUEUE", "queued jobs", low=1, high=1_000_000)
    queue_per_key: int = setting(
        5_000, "NEEDLEBENCH_MAX_QUEUE_PER_KEY", "queued jobs of one key", low=1, high=1_000_000
    )
    rate_per_key: float = setting(
        100,
        "NEEDLEBENCH_RATE_PER_KEY",
        "requests a second of one key, bursts of twice as many; 0 = any",
        low=0,
        high=100_000,
    )
    nodes: int = setting(60_000, "NEEDLEBENCH_MAX_NODES", "nodes of a tissue mesh", low=8, high=1_000_000)
    steps: int = setting(200_000, "NEEDLEBENCH_MAX_STEPS", "steps of a job", low=1, high=1_000_000)
    job_hours: float = setting(
        24, "NEEDLEBENCH_MAX_JOB_HOURS", "hours that a job may take by estimate", low=0.001, high=1000
    )
    job_memory_mb: int = setting(
        4096,
        "NEEDLEBENCH_JOB_MEMORY_MB",
        "MB of memory of a job, by estimate and while it runs",
        low=700,
        high=1_000_000,
    )

    @property
    def body_bytes(self) -> int:
        """Of a request, at most."""
        return round(self.body_mb * 1e6)

    @property
    def upload_bytes(self) -> int:
        """Of an uploaded file, at most."""
        return round(self.upload_mb * 1e6)


class Settings(Section):
    """Every setting of the service.

    data: folder of the database, the results and the recordings. port: None = the default one or the next free.
    minimum_free_mb: room on the disk below which no job is started, units of 2^20 bytes.
    public_url: address under which a proxy shows the service, whose host and path it then knows.
    drain_s: how long running jobs may go on once the service was asked to end; then they go back into the queue.
    keep_days, keep_gb: once a day jobs that ended longer ago go, then the oldest until the rest fits; None = no rule.
    backups: copies of the database, one a day, in the data folder [ours].
    runner: `module:function` that does a job in a worker process; tests replace it.
    """

    data: Path = Field(
        default_factory=default_data_dir,
        validation_alias="NEEDLEBENCH_DATA",
        json_schema_extra={"text": "folder of jobs, results, recordings and uploads; as --data"},
    )
    host: str = setting(
        DEFAULT_HOST,
        "NEEDLEBENCH_HOST",
        "address to listen on; as --host",
        flag="--host",
        rule="must be an address, as in 127.0.0.1",
        min_length=1,
    )
    port: int | None = setting(
        None,
        "NEEDLEBENCH_PORT",
        "port to listen on; as --port",
        low=0,
        high=65535,
        flag="--port",
        rule="must be 0 (any free port) to 65535",
    )
    workers: int = setting(
        MAXIMUM_WORKERS,
        "NEEDLEBENCH_WORKERS",
        f"jobs at a time, 1 to {MAXIMUM_WORKERS}; default {MAXIMUM_WORKERS}",
        low=1,
        high=MAXIMUM_WORKERS,
    )
    minimum_free_mb: int = setting(
        MINIMUM_BYTES // 2**20,
        "NEEDLEBENCH_MINIMUM_FREE_MB",
        f"room below which no job is started; default {MINIMUM_BYTES // 2**20}",
        low=0,
        high=1e9,
        rule="must be 0 or more",
    )
    connections: int = setting(
        2000,
        "NEEDLEBENCH_MAX_CONNECTIONS",
        "connections at a time; default 2000, fewer where the system allows fewer open files",
        low=16,
        high=100_000,
    )
    keep_days: float | None = setting(
        None,
        "NEEDLEBENCH_KEEP_DAYS",
        "days after which ended jobs are removed; as --keep-days",
        low=1,
        high=36_500,
    )
    keep_gb: float | None = setting(
        None,
        "NEEDLEBENCH_KEEP_GB",
        "size above which the oldest ended jobs are; as --keep-gb",
        low=0,
        high=1_000_000,
    )
    backups: int = setting(
        7,
        "NEEDLEBENCH_BACKUPS",
        "daily backups of the database that are kept, 0 for none; default 7",
        low=0,
        high=1000,
    )
    api_key: str | None = setting(
        None,
        "NEEDLEBENCH_API_KEY",
        "a key of scope admin, beside those of `needlebench key`",
        rule="must be printable ASCII characters without spaces",
        pattern="^[!-~]+$",
        repr=False,
    )
    public_url: str | None = setting(
        None,
        "NEEDLEBENCH_PUBLIC_URL",
        "address under which a proxy shows the service, as https://lab.example/needles; it then needs a key",
        rule="must be http or https, a host and perhaps a plain path, as in https://lab.example/needles",
        pattern=r"^https?://[A-Za-z0-9.-]+(:[0-9]{1,5})?(/[A-Za-z0-9_~-][A-Za-z0-9._~-]*)*/?$",
    )
    drain_s: float = Field(0.0, ge=0, le=86400, json_schema_extra={"label": "--drain", "rule": "must be 0 to 86400 s"})
    limits: Limits = Field(default_factory=Limits)
    runner: str = RUNNER

    @field_validator("public_url")
    @classmethod
    def _no_own_path(cls, value: str | None) -> str | None:
        if (first := urlsplit(value or "").path.partition("/")[2].partition("/")[0]) in _OWN_PATHS.split():
            raise ValueError(f"must not begin its path with /{first}, which is the service's own")
        return value

    @property
    def loopback(self) -> bool:
        """Whether only this machine can reach the service."""
        return is_loopback(self.host)

    @property
    def exposed(self) -> bool:
        """Whether others than this machine can reach the service, by its address or through a proxy."""
        return not self.loopback or self.public_url is not None

    @property
    def public_host(self) -> str | None:
        """Host and port of the address that a proxy shows, in lower case."""
        return None if self.public_url is None else urlsplit(self.public_url).netloc.lower()

    @property
    def root_path(self) -> str:
        """Path of the address that a proxy shows, without a slash at its end; empty without one."""
        return "" if self.public_url is None else urlsplit(self.public_url).path.rstrip("/")

    @property
    def minimum_free_bytes(self) -> int:
        """Room on the disk below which no job is started."""
        return self.minimum_free_mb * 2**20

    @property
    def database(self) -> Path:
        """The file of the database."""
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
    ) -> Self:
        """Flags first, then environment variables, then defaults. Raises SettingsError."""
        return cls.from_environment(
            data=data_dir() if data is None else data.expanduser().absolute(),
            host=host or None,
            port=port,
            drain_s=drain_s,
            keep_days=keep_days,
            keep_gb=keep_gb,
            limits=Limits.from_environment(),
        )

    def check_exposure(self) -> None:
        """Raises SettingsError for an address that others can reach as long as there is no key. Reads the database."""
        if self.api_key is None and self.exposed and not keys_exist(self.database):
            raise SettingsError([Problem("--host", self.host, _refusal(self.host, self.port))])


def variables_help() -> list[tuple[str, str]]:
    """The environment variables and what they set; those of limits are in `limits_help`."""
    return [(str(info.validation_alias), note_of(info, "text")) for info in variables_of(Settings)]


def limits_help() -> list[tuple[str, str]]:
    """Variable and meaning of each limit, with its default."""
    return [
        (str(info.validation_alias), f"{note_of(info, 'text')}; default {info.default:g}")
        for info in variables_of(Limits)
    ]


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
