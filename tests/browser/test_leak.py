"""Pages that are open all day: after ten minutes of live progress they hold no more than after one."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from tests.acceptance.server import running_server, until
from tests.browser.browser import PROGRAM, chromium, opened

if TYPE_CHECKING:
    from pathlib import Path

    from playwright.sync_api import Page

pytest.importorskip("playwright.sync_api", reason="needs playwright, of the dev extra")
pytestmark = [
    pytest.mark.long,
    pytest.mark.skipif(PROGRAM is None, reason="needs chromium: no chromium or chromium-browser on the PATH"),
]

BEFORE_S, AFTER_S = 60, 600
MORE = {"JSEventListeners": 10, "Nodes": 100, "JSHeapUsedSize": 2e6}  # that the data themselves may take


def held(page: Page) -> dict[str, float]:
    """Listeners, nodes and bytes that the page holds, after a collection of its garbage."""
    session = page.context.new_cdp_session(page)
    session.send("Performance.enable")
    for _ in range(3):  # what a collection frees may hold other things
        session.send("HeapProfiler.collectGarbage")
        page.wait_for_timeout(200)
    metrics = {one["name"]: one["value"] for one in session.send("Performance.getMetrics")["metrics"]}
    session.detach()
    return {name: metrics[name] for name in MORE}


def test_live_pages_do_not_grow_in_ten_minutes(tmp_path: Path) -> None:
    with (
        running_server(tmp_path, runner="tests.browser.long_runner:run_job", workers=1) as server,
        chromium() as browser,
    ):
        job = server.client.submit({"name": "all day"})
        until(lambda: server.client.job(job.id).progress.step > 0)
        with opened(browser, server.url) as one, opened(browser, server.url) as many:
            one.goto(f"/jobs/{job.id}")
            one.locator("#plot-error canvas").wait_for()
            many.locator(f"tr[data-key='{job.id}']").wait_for()
            one.wait_for_timeout(1e3 * BEFORE_S)
            before = {"the job": held(one), "the list": held(many)}
            shown = int(one.locator("[data-step]").inner_text())
            one.wait_for_timeout(1e3 * AFTER_S)
            after = {"the job": held(one), "the list": held(many)}
            assert int(one.locator("[data-step]").inner_text()) - shown > AFTER_S / 2  # it was live all the time
            print(before, after)
            for name, metrics in after.items():
                more = {key: value - before[name][key] for key, value in metrics.items()}
                assert {key: value for key, value in more.items() if value > MORE[key]} == {}, (name, before, after)
        server.client.cancel(job.id)
