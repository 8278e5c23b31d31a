"""Every page on a phone and on a desk, in light and dark: nothing that axe-core finds, and nothing that overflows."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import pytest

from tests.acceptance.server import running_server
from tests.browser.browser import PROGRAM, chromium, opened
from tests.service.learned import model_bytes

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from playwright.sync_api import Page

    from needlebench import Client

pytest.importorskip("playwright.sync_api", reason="needs playwright, of the dev extra")
axe = pytest.importorskip(
    "axe_playwright_python.sync_playwright", reason="needs axe-playwright-python, of the dev extra"
)
pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(PROGRAM is None, reason="needs chromium: no chromium or chromium-browser on the PATH"),
]

WIDTHS = (390, 1440)
PAGES = {  # what is looked at -> its address, with names of `_things` in it
    "jobs": "/",
    "jobs, sorted and grouped": "/?group=campaign&sort=rmse&column=state&column=note&column=duration",
    "no jobs": "/?q=nothing",
    "form": "/submit?from=demo",
    "a job": "/jobs/{done}",
    "a job that failed": "/jobs/{failed}",
    "jobs side by side": "/side-by-side?job={done}&job={other}",
    "campaigns": "/campaigns",
    "a campaign": "/campaigns/{campaign}",
    "schedules": "/schedules",
    "trends": "/trends",
    "a trend": "/trends/arms",
    "comparison": "/compare?a={campaign}&every=1",
    "models": "/models",
    "a bundled model": "/models/elm",
    "an uploaded model": "/models/{model}",
    "the API": "/docs",
    "nothing there": "/jobs/0",
    "login": "/login",
}


WRONG_KEY = """
() => {
  const form = document.createElement("form");
  Object.assign(form, { method: "post", action: "/login" });
  form.append(Object.assign(document.createElement("input"), { name: "key", value: "wrong" }));
  document.body.append(form);
  form.submit();
}
"""


@pytest.fixture(scope="module")
def filled(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Page, dict[str, str]]]:
    """A page on one service for all addresses, and the ids of what is in it."""
    folder = tmp_path_factory.mktemp("axe")
    with running_server(folder, runner="tests.browser.runner:run_job", workers=1) as server:
        things = _things(server.client, folder)
        with chromium() as browser, opened(browser, server.url, expected="") as page:
            yield page, things


def _things(client: Client, folder: Path) -> dict[str, str]:
    """Something of every kind."""
    jobs = {name: client.wait(client.submit({"name": name}).id).id for name in ("done", "other", "broken")}
    client.edit(jobs["done"], tags=["liver", "paper"], note="one\ntwo")
    grid = {"tissue.young_kpa": [3, 6.3], "controller.kind": ["ifem", "open_loop"]}
    campaign = client.start_campaign({"name": "arms", "grid": grid})
    client.wait_campaign(campaign.id)
    nightly = {"name": "nightly", "cron": "0 2 * * *", "campaign": {"name": "arms", "grid": grid}}
    schedule = client._json("POST", "/api/v1/schedules", json=nightly)["id"]
    client._json("POST", f"/api/v1/schedules/{schedule}/trigger")
    file = folder / "mine.json"
    file.write_bytes(model_bytes("linear"))
    model = client.upload(file).id
    return {
        "done": jobs["done"],
        "other": jobs["other"],
        "failed": jobs["broken"],
        "campaign": campaign.id,
        "model": model,
    }


@pytest.mark.parametrize("what", PAGES)
def test_nothing_is_in_the_way_of_anybody(filled: tuple[Page, dict[str, str]], what: str) -> None:
    page, things = filled
    page.emulate_media(color_scheme="light")
    page.goto(PAGES[what].format(**things))
    if what == "login":  # without keys it leads on at once; a wrong key is told by the form itself
        with page.expect_navigation():
            page.evaluate(WRONG_KEY)
    page.evaluate("for (const one of document.querySelectorAll('details')) one.open = true")
    checker = axe.Axe()
    for scheme in ("light", "dark"):
        page.emulate_media(color_scheme=scheme)
        for width in WIDTHS:
            page.set_viewport_size({"width": width, "height": 900})
            page.wait_for_timeout(200)  # a page settles a moment after its width has changed
            assert page.evaluate("document.documentElement.scrollWidth <= innerWidth"), (width, scheme)
            # of a scheme only the colours differ
            options: dict[str, Any] = {"runOnly": ["color-contrast"]} if scheme == "dark" else {}
            found = checker.run(page, options={"resultTypes": ["violations"], **options})
            told = [(one["id"], [node["target"] for node in one["nodes"][:3]]) for one in found.response["violations"]]
            assert not told, (width, scheme, told)
