"""The history of a service is bounded: an hour in steps of ten seconds, a day in steps of five minutes."""

from __future__ import annotations

from service.engine.history import COARSE, EVERY_S, FINE, History, Moment


def test_it_keeps_an_hour_finely_and_a_day_coarsely_and_no_more() -> None:
    now = [0.0]

    def look() -> Moment:
        return Moment(
            at=now[0], queued=1, running=0, busy=0, ready=2, disk_free_gb=1.0, memory_mb=None, available_mb=None
        )

    history = History(look, clock=lambda: now[0])
    for _ in range(3 * 24 * 360):  # three days
        history.tick()
        history.tick()  # too early: nothing is kept
        now[0] += EVERY_S
    moments = history.moments()
    times = [moment.at for moment in moments]
    assert times == sorted(set(times))
    assert len(times) <= FINE + COARSE
    last = now[0] - EVERY_S
    assert [last - at for at in times[-FINE:]] == [EVERY_S * i for i in reversed(range(FINE))]
    assert last - times[0] <= 24 * 3600.0
    assert last - times[0] > 23 * 3600.0
