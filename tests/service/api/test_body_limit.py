"""Bodies: whole before they are looked at, large ones one at a time, and never more than what is said."""

from __future__ import annotations

import asyncio
from typing import TYPE_CHECKING, Any

from service.api.middleware import body_limit
from service.api.middleware.body_limit import LARGE_BYTES, BodyLimit

if TYPE_CHECKING:
    import pytest


class App:
    """Counts how many requests it has in hand at a time; each is answered once `go` is set."""

    def __init__(self) -> None:
        self.now = self.most = self.answered = 0
        self.go = asyncio.Event()
        self.bodies: list[int] = []

    async def __call__(self, _scope: Any, receive: Any, send: Any) -> None:
        message = await receive()
        self.bodies.append(len(message["body"]))
        assert not message["more_body"]
        self.now += 1
        self.most = max(self.most, self.now)
        await self.go.wait()
        await asyncio.sleep(0)
        self.now -= 1
        self.answered += 1
        await send({"type": "http.response.start", "status": 200, "headers": []})
        await send({"type": "http.response.body", "body": b""})


async def ask(layer: BodyLimit, parts: list[bytes], path: str = "/", disconnects: bool = False) -> int | None:
    """The status of the answer; None without one."""
    waiting = [{"type": "http.request", "body": part, "more_body": True} for part in parts[:-1]]
    last = {"type": "http.disconnect"} if disconnects else {"type": "http.request", "body": parts[-1]}
    messages = iter([*waiting, last])
    statuses: list[int] = []

    async def receive() -> Any:
        await asyncio.sleep(0)
        return next(messages)

    async def send(message: Any) -> None:
        if message["type"] == "http.response.start":
            statuses.append(message["status"])

    scope = {"type": "http", "method": "POST", "path": path, "headers": [], "query_string": b""}
    await layer(scope, receive, send)
    return statuses[0] if statuses else None


def layer_of(app: App, most: int = 1_000_000) -> BodyLimit:
    return BodyLimit(app, maximum_bytes=most, exceptions={"/uploads": 5_000_000})


def test_large_bodies_are_looked_at_one_by_one_and_small_ones_pass_them() -> None:
    async def scenario() -> None:
        app = App()
        layer = layer_of(app)
        large = [asyncio.ensure_future(ask(layer, [b"x" * LARGE_BYTES, b"x"])) for _ in range(5)]
        while app.now != 1:
            await asyncio.sleep(0)
        small = [asyncio.ensure_future(ask(layer, [b"x"])) for _ in range(3)]
        while app.now != 4:
            await asyncio.sleep(0)
        app.go.set()
        assert await asyncio.gather(*large, *small) == [200] * 8
        assert app.most == 4  # one large, three small
        assert sorted(app.bodies) == [1] * 3 + [LARGE_BYTES + 1] * 5
        assert layer._waiting_bytes == 0

    asyncio.run(scenario())


def test_a_body_that_grows_too_long_or_ends_early_never_arrives() -> None:
    async def scenario() -> None:
        app = App()
        app.go.set()
        layer = layer_of(app, most=10)
        assert await ask(layer, [b"x" * 6, b"x" * 5]) == 413
        assert await ask(layer, [b"x" * 6, b""], disconnects=True) is None
        assert app.bodies == []
        assert await ask(layer, [b"x" * 6, b"x" * 4]) == 200
        assert layer._waiting_bytes == 0

    asyncio.run(scenario())


def test_what_waits_is_bounded_all_together(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(body_limit, "WAITING_BYTES", 25)

    async def scenario() -> None:
        app = App()
        layer = layer_of(app, most=10)
        held = [asyncio.ensure_future(ask(layer, [b"x" * 10])) for _ in range(2)]
        while app.now != 2:
            await asyncio.sleep(0)
        assert await ask(layer, [b"x" * 10]) == 503
        app.go.set()
        assert await asyncio.gather(*held) == [200, 200]
        assert await ask(layer, [b"x" * 10]) == 200

    asyncio.run(scenario())
