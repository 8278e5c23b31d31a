"""The connection of a campaign to a Dask scheduler, made again when the scheduler dies and comes back."""

from __future__ import annotations

import asyncio
import logging
import socket
import time
from contextlib import suppress
from typing import TYPE_CHECKING
from urllib.parse import urlsplit

from distributed import Client

from service.cluster.certificates import security_of
from service.cluster.identity import identity
from service.cluster.sign_on import TOPIC, RefusedError, SignOn, prepare_scheduler
from simcore.errors import NeedlebenchError

if TYPE_CHECKING:
    from collections.abc import Callable
    from typing import Any

    from distributed import Future

    from service.cluster.address import ClusterAddress

_CONNECT_S = 60.0  # on a machine that has much else to do
_PROBE_S = 10.0
_COUNT_S = 2.0  # between two counts of the workers


class NoSchedulerError(NeedlebenchError):
    """No scheduler answers for longer than anybody wants to wait."""


class Connection:
    """A client of the scheduler at an address. say: one line of text; patience_s: for a scheduler to come (back)."""

    def __init__(self, address: ClusterAddress, *, say: Callable[[str], None], patience_s: float) -> None:
        self._address, self._say, self._patience_s = address, say, patience_s
        self._client: Client | None = None
        self._doubted = False
        self._slots, self._counted_s = 0, -_COUNT_S
        for name in ("distributed", "distributed.client", "distributed.core"):  # what they say is said here, in a line
            logging.getLogger(name).setLevel(logging.CRITICAL)

    def open(self) -> None:
        """Connect, whatever was before. Raises NoSchedulerError, RefusedError, ScenarioError."""
        self.close()
        deadline, waits = time.monotonic() + self._patience_s, False
        while True:
            with suppress(OSError, TimeoutError, asyncio.CancelledError):
                if (endpoint := self._address.endpoint()) is not None:
                    self._connect(endpoint)
                    return
            if time.monotonic() > deadline:
                message = f"no scheduler answers at {self._address.text} for {self._patience_s:g} s"
                raise NoSchedulerError(f"{message}; the same command goes on from here once one does")
            if not waits:
                self._say(f"waiting for a scheduler at {self._address.text}")
            waits = True
            time.sleep(0.5)

    def _connect(self, endpoint: str) -> None:
        parts = urlsplit(endpoint)  # a scheduler that was killed leaves its file, and Dask would knock there for long
        socket.create_connection((parts.hostname or "", parts.port or 0), timeout=_PROBE_S).close()
        security = security_of(self._address.tls_folder())
        client = Client(endpoint, security=security, timeout=_CONNECT_S, set_as_default=False)
        self._client, self._doubted, self._counted_s = client, False, -_COUNT_S
        try:
            refusal = client.run_on_scheduler(prepare_scheduler, identity())
            if refusal is not None:
                raise RefusedError(f"the cluster at {endpoint} does not take this campaign: {refusal}")
            client.subscribe_topic(TOPIC, self._hear)
            client.register_plugin(SignOn(identity()))
        except ModuleNotFoundError as error:
            start = "start it with `needlebench cluster scheduler`, in the environment of this command"
            raise RefusedError(f"the scheduler at {endpoint} lacks {error.name}: {start}") from None

    def _hear(self, event: tuple[float, str]) -> None:
        self._say(f"warning: {event[1]}")

    @property
    def lost(self) -> bool:
        """Whether the scheduler is gone, for what is known here."""
        return self._client is None or self._doubted or self._client.status != "running"

    def doubt(self) -> None:
        """The scheduler has lost something: it may be another one by now, which nobody has prepared."""
        self._doubted = True

    def slots(self) -> int:
        """How many workers there are; looked up now and then."""
        if self._client is not None and time.monotonic() - self._counted_s > _COUNT_S:
            with suppress(OSError, TimeoutError, asyncio.CancelledError):
                self._slots = len(self._client.nthreads())
            self._counted_s = time.monotonic()
        return self._slots

    def submit(self, function: Callable[[Any], Any], argument: Any, key: str) -> Future[Any]:
        """Have it called on some worker."""
        assert self._client is not None, "open"
        return self._client.submit(function, argument, key=key, pure=False)

    def close(self) -> None:
        """Leave the scheduler."""
        client, self._client = self._client, None
        if client is not None:
            with suppress(OSError, TimeoutError, asyncio.CancelledError, RuntimeError):
                client.close(timeout=2)
