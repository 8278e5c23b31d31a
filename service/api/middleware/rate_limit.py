"""How many requests one caller may send: a token bucket each."""

from __future__ import annotations

import threading
from collections.abc import Callable

_BURST_S = 2.0
_FORGET_ABOVE = 1000  # callers


class RateLimit:
    """`per_s` requests a second for each caller, at most two seconds' worth at once. clock: seconds, monotonic."""

    def __init__(self, per_s: float, clock: Callable[[], float]) -> None:
        self._per_s = per_s
        self._clock = clock
        self._lock = threading.Lock()
        self._buckets: dict[str, tuple[float, float]] = {}  # caller -> (tokens, time of its last request)
        self._forget_above = _FORGET_ABOVE

    def wait_s(self, caller: str) -> float:
        """0 if the request may go on, which is then counted; else the seconds until the next one may."""
        if not self._per_s:
            return 0.0
        most = max(1.0, _BURST_S * self._per_s)
        with self._lock:
            now = self._clock()
            tokens, before = self._buckets.get(caller, (most, now))
            tokens = min(most, tokens + (now - before) * self._per_s)
            allowed = tokens >= 1.0
            self._buckets[caller] = (tokens - allowed, now)
            if len(self._buckets) > self._forget_above:
                self._forget(before=now - most / self._per_s)
        return 0.0 if allowed else (1.0 - tokens) / self._per_s

    def _forget(self, *, before: float) -> None:
        """Drop callers whose last request is older: their buckets are full again, like those of newcomers."""
        self._buckets = {caller: bucket for caller, bucket in self._buckets.items() if bucket[1] > before}
        self._forget_above = max(_FORGET_ABOVE, 2 * len(self._buckets))
