"""Many clients of one service, in a process of their own that costs little and imports little.

`python -m tests.chaos.clients URL SECONDS LONG_POLL_S < SCENARIOS`, a JSON list with one for each client. A client
submits it at a random moment of the first half, then follows the job as `Client.wait` does, by long polls that answer
each change, and reads its status besides, every 10 s. What was measured is printed as JSON.
"""

from __future__ import annotations

import asyncio
import json
import random
import sys
import time
from dataclasses import asdict, dataclass, field
from typing import Any
from urllib.parse import urlsplit

READ_S = 10.0  # between two status reads of a client
_JOBS = "/api/v1/jobs"


@dataclass
class Measured:
    """Latencies in ms; jobs: the ids that were acknowledged; cpu_s: of this process."""

    submit_ms: list[float] = field(default_factory=list)
    read_ms: list[float] = field(default_factory=list)
    polls: int = 0
    jobs: list[str] = field(default_factory=list)
    errors: list[str] = field(default_factory=list)
    cpu_s: float = 0.0


class Connection:
    """One connection that is kept, as plain as HTTP/1.1 can be."""

    def __init__(self, url: str) -> None:
        self._place = urlsplit(url)
        self._streams: tuple[asyncio.StreamReader, asyncio.StreamWriter] | None = None

    async def ask(self, method: str, path: str, *, body: bytes = b"", headers: str = "") -> tuple[int, str, bytes]:
        """Status, ETag and body of the answer."""
        reader, writer = await self._opened()
        head = f"{method} {path} HTTP/1.1\r\nHost: {self._place.netloc}\r\nContent-Length: {len(body)}\r\n{headers}\r\n"
        writer.write(head.encode() + body)
        first, *lines = (await reader.readuntil(b"\r\n\r\n")).decode().splitlines()
        told = {name.lower(): value for name, _, value in (line.partition(": ") for line in lines)}
        content = await reader.readexactly(int(told.get("content-length", "0")))
        return int(first.split()[1]), told.get("etag", ""), content

    async def _opened(self) -> tuple[asyncio.StreamReader, asyncio.StreamWriter]:
        """The connection; a new one when the server has closed it, as it does with idle ones."""
        if self._streams is not None and self._streams[0].at_eof():
            self.close()
            self._streams = None
        if self._streams is None:
            self._streams = await asyncio.open_connection(self._place.hostname, self._place.port)
        return self._streams

    def close(self) -> None:
        if self._streams is not None:
            self._streams[1].close()


@dataclass(frozen=True)
class Plan:
    """What all clients share. end: monotonic clock, s."""

    url: str
    end: float
    long_poll_s: float
    chance: random.Random


async def one(plan: Plan, scenario: Any, measured: Measured) -> None:
    """A client: its submission, its long polls and its status reads until the end."""
    await asyncio.sleep(plan.chance.uniform(0, (plan.end - time.monotonic()) / 2))
    own, other = Connection(plan.url), Connection(plan.url)
    try:
        body = json.dumps({"scenario": scenario}).encode()
        started = time.perf_counter()
        status, _, content = await own.ask("POST", _JOBS, body=body, headers="Content-Type: application/json\r\n")
        measured.submit_ms.append(1e3 * (time.perf_counter() - started))
        if status != 202:
            measured.errors.append(f"submit: {status} {content[:200]!r}")
            return
        job = json.loads(content)["id"]
        measured.jobs.append(job)
        both = asyncio.gather(_follow(own, job, measured, plan), _read(other, job, measured, plan))
        await asyncio.wait_for(both, max(plan.end - time.monotonic(), 0.1))
    except TimeoutError:
        pass
    except (OSError, asyncio.IncompleteReadError, ValueError) as error:
        measured.errors.append(f"{type(error).__name__}: {error}")
    finally:
        own.close()
        other.close()


async def _follow(connection: Connection, job: str, measured: Measured, plan: Plan) -> None:
    """Long polls until the job has ended."""
    tag = ""
    while True:
        known = f"If-None-Match: {tag}\r\n" if tag else ""
        wait_s = plan.long_poll_s if tag else 0
        status, tag, content = await connection.ask("GET", f"{_JOBS}/{job}?wait={wait_s:g}", headers=known)
        measured.polls += 1
        if status not in (200, 304):
            measured.errors.append(f"long poll: {status} {content[:200]!r}")
            return
        if status == 200 and _ended(json.loads(content)):
            return


async def _read(connection: Connection, job: str, measured: Measured, plan: Plan) -> None:
    """Status reads, whether it has ended or not."""
    await asyncio.sleep(plan.chance.uniform(0, READ_S))
    while True:
        started = time.perf_counter()
        status, _, content = await connection.ask("GET", f"{_JOBS}/{job}")
        measured.read_ms.append(1e3 * (time.perf_counter() - started))
        if status != 200:
            measured.errors.append(f"read: {status} {content[:200]!r}")
        await asyncio.sleep(READ_S)


def _ended(job: dict[str, Any]) -> bool:
    return job["state"] not in ("queued", "running")


async def _all(url: str, seconds: float, long_poll_s: float, scenarios: list[Any]) -> Measured:
    measured = Measured()
    plan = Plan(url, time.monotonic() + seconds, long_poll_s, random.Random(len(scenarios)))
    await asyncio.gather(*(one(plan, scenario, measured) for scenario in scenarios))
    return measured


def main() -> None:
    url, seconds, long_poll_s = sys.argv[1], float(sys.argv[2]), float(sys.argv[3])
    measured = asyncio.run(_all(url, seconds, long_poll_s, json.load(sys.stdin)))
    measured.cpu_s = time.process_time()
    print(json.dumps(asdict(measured)))


if __name__ == "__main__":
    main()
