"""Thousands of generated requests over every route: no error of the server, and nothing that it keeps of them."""

from __future__ import annotations

import http.client
import json
import re
from collections import Counter, defaultdict
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from hypothesis import HealthCheck, Phase, Verbosity, given, seed, settings
from hypothesis import strategies as st

from tests.acceptance.server import Server, running_server, until
from tests.chaos.flat import Held
from tests.chaos.hostile import IDS, KNOWN, PAGES, allowed_and_forbidden, malicious
from tests.chaos.near_limits import UPLOAD_MB, near_limits
from tests.chaos.wire import Request, ask

if TYPE_CHECKING:
    import random
    from collections.abc import Callable
    from pathlib import Path

    import pytest

_KEY = "chaos"
_WARM = 0.1  # share of the requests after which the first sample is taken
_MORE_DESCRIPTORS = 20  # [ours] threads each keep a connection to the database: three descriptors
_FIRST_MB = 75.0  # [ours] since half of them: what is imported at a rare first use (SciPy, 40 MB), and the allocator
# [ours] by all requests a third time, of which nothing is new; or by each. SQLite keeps up to 2 MB of pages for each
# thread, and these fill up for a while: 11 MB were seen on a busy machine, 2 in the long form.
_AGAIN_MB, _AGAIN_KB = 20.0, 1.0
_PROBLEM, _HTML = "application/problem+json", "text/html"


class Asker:
    """Sends requests, remembers ids that were given out, and keeps what should not have been answered."""

    def __init__(self, server: Server, chance: random.Random) -> None:
        self._server, self._chance = server, chance
        self._ids: dict[str, list[str]] = defaultdict(lambda: ["0"])
        self.asked: list[Request] = []
        self.statuses: Counter[int] = Counter()
        self.wrong: list[str] = []
        self.slowest_s = 0.0

    def __call__(self, request: Request) -> None:
        self.asked.append(request)
        request = self._known(request)
        try:
            answer = ask(self._server.url, request)
        except (OSError, http.client.HTTPException) as error:
            self.wrong.append(f"{type(error).__name__}: {error}: {request}"[:2000])
            return
        self.statuses[answer.status] += 1
        self.slowest_s = max(self.slowest_s, answer.took_s)
        told = _told(request, answer.status, answer.media_type, answer.body)
        if told:
            self.wrong.append(f"{answer.status} {told}: {request}"[:2000])
        elif request.method == "POST" and answer.status in (200, 201, 202):
            self._remember(request.target, answer.body)

    def _known(self, request: Request) -> Request:
        """With an id that there is, and mostly with the key."""
        target = request.target
        if KNOWN in target:
            kind = next((path for path in IDS.values() if path.rpartition("/")[2] in target), "/api/v1/jobs")
            target = target.replace(KNOWN, self._chance.choice(self._ids[kind][-20:]))
        headers = request.headers
        if self._chance.random() < 0.98 and not any(name.lower() == "authorization" for name, _ in headers):
            headers = (*headers, ("Authorization", f"Bearer {_KEY}"))
        return replace(request, target=target, headers=headers)

    def _remember(self, target: str, body: bytes) -> None:
        for path in IDS.values():
            if re.fullmatch(f"{path}(\\?.*)?", target):
                made = json.loads(body)
                if "id" in made:
                    self._ids[path].append(str(made["id"]))


def _told(request: Request, status: int, media_type: str, body: bytes) -> str | None:
    """What is wrong with an answer."""
    if status >= 500 and status not in (503, 507):
        return f"{body[:300]!r}"
    if status < 400:
        return None
    if media_type == _HTML and not request.target.startswith(("/api/", "/recordings/")) and status in (401, 404):
        return None  # a page that says so, for people
    if media_type != _PROBLEM:
        return f"is {media_type}, {body[:300]!r}"
    if request.method == "HEAD":
        return None
    problem = json.loads(body)
    return None if problem["status"] == status and problem["detail"] else f"{problem}"


def _each(strategy: st.SearchStrategy[Request], count: int, number: int, do: Callable[[Request], None]) -> None:
    """Generate about so many, no two alike."""

    @seed(number)
    @settings(
        max_examples=count,
        deadline=None,
        database=None,
        phases=[Phase.generate],
        suppress_health_check=list(HealthCheck),
        verbosity=Verbosity.quiet,
    )
    @given(strategy)
    def run(request: Request) -> None:
        do(request)

    run()


def test_generated_requests(
    tmp_path: Path,
    requests: int,
    chance: random.Random,
    figures: dict[str, object],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("NEEDLEBENCH_RATE_PER_KEY", "0")
    monkeypatch.setenv("NEEDLEBENCH_MAX_QUEUE", "100")
    monkeypatch.setenv("NEEDLEBENCH_MAX_UPLOAD_MB", str(UPLOAD_MB))
    with running_server(tmp_path, runner="tests.chaos.instant:run_job", api_key=_KEY) as server:
        until(lambda: Held.by(server.process.pid).processes >= 2)
        document = _document(server)
        asker = Asker(server, chance)
        kinds = [allowed_and_forbidden(document), malicious([*document["paths"], *PAGES]), near_limits()]
        held = []
        for share in (_WARM, 0.5, 1.0):
            while len(asker.asked) < share * requests:
                missing = round(share * requests) - len(asker.asked)
                for kind in kinds:
                    _each(kind, max(1, min(missing // len(kinds), 500)), chance.getrandbits(32), asker)
            held.append(_at_rest(server))
        every = asker.asked[:]
        for _ in range(2):
            for request in every:
                asker(request)
            held.append(_at_rest(server))
        assert server.process.poll() is None
    assert not asker.wrong, f"{len(asker.wrong)} of {len(asker.asked)}:\n" + "\n".join(asker.wrong[:40])
    warm, half, _, twice, thrice = held
    figures.update(requests=len(asker.asked), statuses=dict(sorted(asker.statuses.items())), of_500=asker.statuses[500])
    figures.update(processes=[one.processes for one in held], descriptors=[one.descriptors for one in held])
    figures.update(memory_mb=[one.memory_mb for one in held], slowest_s=round(asker.slowest_s, 2))
    assert len({one.processes for one in held}) == 1
    assert thrice.descriptors <= warm.descriptors + _MORE_DESCRIPTORS
    assert twice.memory_mb <= half.memory_mb + _FIRST_MB
    assert thrice.memory_mb <= twice.memory_mb + max(_AGAIN_MB, 1e-3 * _AGAIN_KB * requests)


def _at_rest(server: Server) -> Held:
    """What it holds once all jobs are done."""
    until(lambda: _quiet(server), patience_s=120)
    return Held.by(server.process.pid)


def _quiet(server: Server) -> bool:
    """Whether no job is left to do."""
    headers = (("Authorization", f"Bearer {_KEY}"),)
    found = [ask(server.url, Request("GET", f"/api/v1/jobs?state={state}", headers)) for state in ("queued", "running")]
    return all(json.loads(answer.body)["items"] == [] for answer in found)


def _document(server: Server) -> Any:
    return json.loads(ask(server.url, Request("GET", "/openapi.json", (("Authorization", f"Bearer {_KEY}"),))).body)
