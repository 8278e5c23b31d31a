"""Connections that keep the service waiting: each wait has an end, and there is room for those who really ask."""

from __future__ import annotations

import asyncio
import json
from contextlib import asynccontextmanager
from functools import partial
from typing import TYPE_CHECKING, Any

import pytest
import uvicorn
from uvicorn.server import ServerState

from service.server.uvicorn_overrides import ConnectionLimits, Protocol

if TYPE_CHECKING:
    from collections.abc import AsyncIterator, Coroutine

PATIENCE_S = 30.0
GET = b"GET / HTTP/1.1\r\nHost: localhost\r\n\r\n"
OPENED: list[asyncio.StreamWriter] = []
Streams = tuple[asyncio.StreamReader, asyncio.StreamWriter]


async def app(scope: Any, receive: Any, send: Any) -> None:
    """Reads the body, then says how long it was and which host was asked for; /flood answers at length."""
    length = 0
    while True:
        message = await receive()
        if message["type"] == "http.disconnect":
            return
        length += len(message["body"])
        if not message.get("more_body"):
            break
    await send({"type": "http.response.start", "status": 200, "headers": []})
    for _ in range(1000 if scope["path"] == "/flood" else 0):
        await send({"type": "http.response.body", "body": b"x" * 65_536, "more_body": True})
        await asyncio.sleep(0)  # after the end of a connection nothing else waits here
    hosts = [value.decode() for name, value in scope["headers"] if name == b"host"]
    body = json.dumps({"length": length, "hosts": hosts, "path": scope["path"]}).encode()
    await send({"type": "http.response.body", "body": body})


@asynccontextmanager
async def listening(**limits: Any) -> AsyncIterator[tuple[int, ServerState]]:
    config = uvicorn.Config(app, lifespan="off", log_config=None)
    config.load()
    state = ServerState()
    loop = asyncio.get_running_loop()
    made = partial(Protocol, config=config, server_state=state, app_state={}, limits=ConnectionLimits(**limits))
    server = await loop.create_server(made, "127.0.0.1", 0)
    try:
        yield server.sockets[0].getsockname()[1], state
    finally:
        server.close()
        for connection in tuple(state.connections):
            connection.transport.abort()
        for writer in OPENED:
            writer.transport.abort()
        await asyncio.sleep(0.05)
        OPENED.clear()


def checked(scenario: Coroutine[Any, Any, None]) -> None:
    asyncio.run(asyncio.wait_for(scenario, PATIENCE_S))


async def connected(port: int, data: bytes = b"") -> Streams:
    reader, writer = await asyncio.open_connection("127.0.0.1", port)
    OPENED.append(writer)
    writer.write(data)
    return reader, writer


async def status_of(reader: asyncio.StreamReader) -> int:
    return int((await reader.readline()).split()[1])


@pytest.mark.slow
@pytest.mark.parametrize("sent", [b"GET / HTTP/1.1\r\nHost: loc", b"G"])
def test_headers_that_do_not_come_to_their_end_are_408(sent: bytes) -> None:
    async def scenario() -> None:
        async with listening(header_s=0.2) as (port, _):
            reader, _ = await connected(port, sent)
            assert await status_of(reader) == 408
            assert b'"request-timeout"' in await reader.read()  # to its end: the connection is closed

    checked(scenario())


@pytest.mark.slow
def test_a_connection_that_says_nothing_is_closed() -> None:
    async def scenario() -> None:
        async with listening(header_s=0.2) as (port, state):
            reader, _ = await connected(port)
            assert await reader.read() == b""
            assert not state.connections

    checked(scenario())


@pytest.mark.slow
def test_a_body_that_drips_is_408_and_one_that_flows_is_read() -> None:
    async def scenario() -> None:
        head = b"POST / HTTP/1.1\r\nHost: localhost\r\nContent-Length: 100000\r\n\r\n"
        async with listening(body_s=0.3, body_bytes=100) as (port, _):
            reader, writer = await connected(port, head)
            answer = asyncio.ensure_future(status_of(reader))
            while not answer.done():
                writer.write(b"x")
                await asyncio.sleep(0.05)
            assert answer.result() == 408
            reader, writer = await connected(port, head)
            for _ in range(10):
                writer.write(b"x" * 10_000)
                await asyncio.sleep(0.1)
            assert await status_of(reader) == 200

    checked(scenario())


@pytest.mark.slow
def test_who_takes_nothing_of_a_long_answer_is_dropped() -> None:
    async def scenario() -> None:
        async with listening(stall_s=0.3) as (port, state):
            _, writer = await connected(port, b"GET /flood HTTP/1.1\r\nHost: localhost\r\n\r\n")
            assert isinstance(writer.transport, asyncio.Transport)
            writer.transport.pause_reading()
            while state.total_requests or len(state.connections) != 1:
                await asyncio.sleep(0.01)
            while state.connections:
                await asyncio.sleep(0.01)

    checked(scenario())


def test_those_who_only_wait_make_room_for_those_who_ask() -> None:
    async def scenario() -> None:
        async with listening(connections=20) as (port, state):
            idle = [await connected(port) for _ in range(60)]
            reader, _ = await connected(port, GET)
            assert await status_of(reader) == 200
            assert len(state.connections) <= 20
            gone = [one for one, _ in idle[:40] if await one.read() == b""]
            assert len(gone) == 40  # those that had waited longest

    checked(scenario())


def test_no_request_that_is_answered_makes_room_and_one_too_many_is_503() -> None:
    async def scenario() -> None:
        async with listening(connections=3) as (port, _):
            busy = [await connected(port, b"GET /flood HTTP/1.1\r\nHost: localhost\r\n\r\n") for _ in range(3)]
            for reader, _ in busy:
                assert await status_of(reader) == 200
            reader, _ = await connected(port)
            assert await status_of(reader) == 503
            assert b'"busy"' in await reader.read()

    checked(scenario())


@pytest.mark.parametrize(
    ("target", "host"),
    [("/a", "localhost"), ("http://evil.example/a", "evil.example"), ("http://u@evil.example:81/a", "evil.example:81")],
)
def test_the_host_of_an_absolute_address_counts_and_not_the_header(target: str, host: str) -> None:
    async def scenario() -> None:
        async with listening() as (port, _):
            request = f"GET {target} HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n"
            reader, _ = await connected(port, request.encode())
            answer = await reader.read()
            told = json.loads(answer[answer.index(b"{") : answer.rindex(b"}") + 1])
            assert (told["hosts"], told["path"]) == ([host], "/a")

    checked(scenario())


@pytest.mark.slow
@pytest.mark.parametrize("target", ["*", "evil.example:80", "http:///a", "a"])
def test_what_is_no_address_is_400(target: str) -> None:
    async def scenario() -> None:
        async with listening() as (port, _):
            reader, _ = await connected(port, f"OPTIONS {target} HTTP/1.1\r\nHost: localhost\r\n\r\n".encode())
            assert await status_of(reader) == 400

    checked(scenario())


def test_fields_after_a_body_are_dropped() -> None:
    async def scenario() -> None:
        head = b"POST / HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\nTransfer-Encoding: chunked\r\n\r\n"
        async with listening() as (port, _):
            reader, _ = await connected(port, head + b"1\r\nx\r\n0\r\nHost: evil.example\r\n\r\n")
            answer = await reader.read()
            assert b'"hosts": ["localhost"]' in answer

    checked(scenario())
