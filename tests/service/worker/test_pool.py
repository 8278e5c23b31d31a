from __future__ import annotations

import os
import threading
from collections.abc import Iterator
from concurrent.futures import wait

import pytest

from service.worker import process as pool


@pytest.fixture
def workman() -> Iterator[pool.Worker]:
    made = pool.Worker()
    yield made
    made.stop()
    assert not made.alive


def test_calls_are_answered_in_their_order_by_one_process(workman: pool.Worker) -> None:
    calls = [workman.call(os.getpid), workman.call(abs, -2), workman.call(os.getpid)]
    first, two, last = [call.result(timeout=60) for call in calls]
    assert (first, two) == (last, 2)
    assert first != os.getpid()


def test_what_is_raised_there_is_raised_here_and_the_worker_goes_on(workman: pool.Worker) -> None:
    with pytest.raises(ValueError, match="invalid literal"):
        workman.call(int, "x").result(timeout=60)
    with pytest.raises(TypeError, match="pickle"):
        workman.call(threading.Lock).result(timeout=60)
    assert workman.call(abs, -3).result(timeout=60) == 3


def test_a_death_is_told_to_who_waits_and_to_who_asks_later(workman: pool.Worker) -> None:
    call = workman.call(os._exit, 7)
    wait([call], timeout=60)
    with pytest.raises(pool.Lost, match=r"died \(exit code 7\)"):
        pool.answer(call)
    workman.stop()
    assert not workman.alive
    with pytest.raises(pool.Lost, match="gone"):
        workman.call(abs, -1)
