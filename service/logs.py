"""Logs: what the service says on standard error, as text or as JSON lines, and the log of each job in its folder."""

from __future__ import annotations

import io
import json
import logging
import sys
import time
import warnings
from contextlib import contextmanager, redirect_stderr, redirect_stdout
from contextvars import ContextVar
from typing import TYPE_CHECKING, Any, Literal, TextIO

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

LOG = "job.log"
MAXIMUM_BYTES = 10 * 2**20  # of one job's log; what comes later is left out
FULL = "the log is full: the rest is left out"
ROOT = "needlebench"
_LONGEST_LINE = 1 << 16

Format = Literal["text", "json"]
request_id: ContextVar[str | None] = ContextVar("request_id", default=None)
_EXTRA = ("job", "attempt", "state", "method", "path", "status", "duration_ms", "request_id")


class JsonLines(logging.Formatter):
    """One JSON object a line: time (UTC), level, logger, message, and the job or request that it belongs to."""

    def format(self, record: logging.LogRecord) -> str:
        """The record as a line of JSON."""
        line: dict[str, Any] = {
            "time": moment(record.created),
            "level": record.levelname.lower(),
            "logger": record.name,
            "message": record.getMessage(),
        }
        line |= {name: getattr(record, name) for name in _EXTRA if hasattr(record, name)}
        if "request_id" not in line and (current := request_id.get()) is not None:
            line["request_id"] = current
        if record.exc_info:
            line["exception"] = self.formatException(record.exc_info)
        return json.dumps(line, default=str)


class _Text(logging.Formatter):
    def formatTime(self, record: logging.LogRecord, datefmt: str | None = None) -> str:  # noqa: N802, ARG002  (logging's)
        return moment(record.created)


def moment(seconds: float) -> str:
    """Seconds since 1970 as in every line of a log, UTC."""
    whole = time.strftime("%Y-%m-%dT%H:%M:%S", time.gmtime(seconds))
    return f"{whole}.{int(seconds % 1 * 1000):03d}Z"


def configure(form: Format, *, stream: TextIO | None = None) -> None:
    """Send the logs to `stream` (default: standard error): warnings as text, or everything as JSON lines."""
    handler = logging.StreamHandler(stream or sys.stderr)
    handler.setFormatter(JsonLines() if form == "json" else _Text("%(levelname)s %(message)s"))
    root = logging.getLogger()
    for old in root.handlers[:]:
        root.removeHandler(old)
    root.addHandler(handler)
    root.setLevel(logging.WARNING)
    logging.getLogger(ROOT).setLevel(logging.INFO if form == "json" else logging.WARNING)


@contextmanager
def job_log(path: Path) -> Iterator[None]:
    """Within, what this process logs, warns and prints goes to the file, line by line with its time."""
    handler = _Bounded(path)
    handler.setFormatter(_Text("%(asctime)s %(levelname)s %(message)s"))
    log = logging.getLogger(ROOT)
    level = log.level
    log.setLevel(logging.INFO)
    log.addHandler(handler)
    printed: Any = _Printed(log)
    try:
        with redirect_stdout(printed), redirect_stderr(printed), warnings.catch_warnings():
            warnings.showwarning = lambda message, category, *_: log.warning("%s: %s", category.__name__, message)
            yield
    finally:
        printed.end()
        log.removeHandler(handler)
        log.setLevel(level)
        handler.close()


class _Bounded(logging.FileHandler):
    """A file that stops growing, and a full disk that stops nobody."""

    def __init__(self, path: Path) -> None:
        super().__init__(path, encoding="utf-8", errors="backslashreplace")
        self._left = MAXIMUM_BYTES

    def emit(self, record: logging.LogRecord) -> None:
        if self._left > 0:
            super().emit(record)

    def format(self, record: logging.LogRecord) -> str:
        """The record with its trace, cut where the log is full."""
        text = super().format(record)
        cut = text[: self._left]
        self._left -= len(text) + 1
        return text if self._left > 0 else f"{cut}\n{FULL}"

    def handleError(self, record: logging.LogRecord) -> None:  # noqa: N802  (logging's)
        """A log that cannot be written is no reason to stop a job."""


class _Printed(io.TextIOBase):
    """Stands for standard output and standard error: each whole line becomes a line of the log."""

    def __init__(self, log: logging.Logger) -> None:
        self._log = log
        self._rest = ""

    def write(self, text: str) -> int:
        """Log the whole lines; what has no end yet waits for it, up to a length."""
        *lines, self._rest = (self._rest + text).split("\n")
        if len(self._rest) > _LONGEST_LINE:
            lines.append(self._rest)
            self._rest = ""
        for line in lines:
            self._log.info("%s", line)
        return len(text)

    def end(self) -> None:
        """Log what has no end."""
        if self._rest:
            self.write("\n")

    def writable(self) -> bool:
        """Always."""
        return True

    def fileno(self) -> int:
        """Of standard output, which leads to the same log."""
        return 1
