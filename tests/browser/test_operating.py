"""Uploads, keys and the service itself in a real browser: what an operator of a lab looks at."""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from tests.acceptance.server import Server, running_server, until
from tests.browser.browser import PATIENCE_MS, PROGRAM, opened
from tests.service.http import idle_service

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page

pytest.importorskip("playwright.sync_api", reason="needs playwright, of the dev extra")
pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(PROGRAM is None, reason="needs chromium: no chromium or chromium-browser on the PATH"),
]

MESH = Path(__file__).resolve().parents[2] / "service" / "cli" / "examples" / "mesh.msh"
DROP = """
([selector, name, text]) => {
  const transfer = new DataTransfer();
  transfer.items.add(new File([text], name));
  const event = new DragEvent("drop", { dataTransfer: transfer, bubbles: true, cancelable: true });
  document.querySelector(selector).dispatchEvent(event);
}
"""


def test_a_mesh_is_dropped_drawn_used_and_deleted_once_no_job_waits_for_it(page: Page, server: Server) -> None:
    page.goto("/uploads")
    page.evaluate(DROP, ["#drop", "notes.txt", "no mesh"])
    page.locator("#drop .problem", has_text="must end in .msh").wait_for()
    assert page.locator("#file").get_attribute("aria-invalid") == "true"
    page.evaluate(DROP, ["#drop", "liver.msh", MESH.read_text()])
    row = page.locator("#uploads tr", has_text="liver.msh")
    row.locator("img").wait_for(timeout=3 * PATIENCE_MS)  # it is checked in a process of its own
    until(lambda: page.evaluate("document.querySelector('#uploads img').naturalWidth") > 0)
    assert "this machine" in row.inner_text()
    row.get_by_role("link", name="liver.msh", exact=True).click()
    page.get_by_role("heading", name="liver.msh").wait_for()
    reference = page.locator("dd.mono").first.inner_text()
    path = {"kind": "line", "entry_mm": [0, 0, 0], "target_mm": [4, 3, 45]}
    tissue = {"mesh_file": reference, "fixed_sets": ["base"]}
    job = server.client.submit({"name": "slow on the mesh", "tissue": tissue, "trajectory": path})
    page.reload()
    page.locator("#users").get_by_role("link", name="slow on the mesh").wait_for()
    page.get_by_role("button", name="Delete").click()
    page.get_by_role("button", name="Yes").click()
    page.locator("#messages", has_text="has not ended and uses the upload").wait_for()
    server.client.cancel(job.id)
    until(lambda: server.client.job(job.id).state == "cancelled")
    page.get_by_role("button", name="Delete").click()
    page.get_by_role("button", name="Yes").click()
    page.wait_for_url("**/uploads")
    assert page.locator("#uploads tr", has_text="liver.msh").count() == 0


def test_a_file_that_is_dropped_on_the_form_of_a_job_is_sent_and_named_in_its_field(page: Page) -> None:
    page.goto("/submit")
    page.locator("details[data-group=tissue]").evaluate("(one) => { one.open = true; }")
    field = page.locator("[data-path='tissue.mesh_file']")
    page.evaluate(DROP, ["[data-path='tissue.mesh_file']", "bad.msh", "no mesh"])
    field.locator(".problem", has_text="cannot be used as a mesh").wait_for(timeout=3 * PATIENCE_MS)
    field.locator("input[type=file]").set_input_files(MESH)
    field.get_by_text("mesh.msh is here.").wait_for(timeout=3 * PATIENCE_MS)
    assert re.fullmatch(r"artefact:[0-9a-f]{64}\.msh", page.locator("#f-tissue-mesh_file").input_value())
    page.get_by_text("JSON that will be sent").first.click()
    assert '"mesh_file": "artefact:' in page.locator("#json").inner_text()


def test_the_service_shows_workers_queue_disk_and_memory_over_time(page: Page) -> None:
    page.goto("/service")
    assert page.locator("#workers tbody tr").count() == 1
    for plot in ("jobs", "workers", "memory", "disk"):
        page.locator(f"#plot-{plot} canvas").wait_for()
    assert re.match(r"\d+ moments; last: service and workers \d+ MB", page.locator("figcaption").nth(2).inner_text())
    page.evaluate("window.first = document.querySelector('#plot-jobs canvas')")
    before = page.evaluate("JSON.parse(document.getElementById('history').dataset.moments).length")
    until(
        lambda: page.evaluate("JSON.parse(document.getElementById('history').dataset.moments).length") > before,
        pause_s=0.5,
    )
    assert page.evaluate("document.querySelector('#plot-jobs canvas') === window.first")
    checks = page.locator("#checks tbody th").all_inner_texts()
    assert {"workers", "threads", "disk", "data folder", "database"} <= set(checks)


def test_keys_are_made_shown_once_and_revoked_and_the_last_one_says_what_it_means(
    browser: Browser, tmp_path: Path
) -> None:
    with idle_service(tmp_path) as (_, service):
        first, text = service.keys.create(scope="admin", note="me")
    with (
        running_server(tmp_path, runner="tests.browser.runner:run_job", workers=1) as server,
        opened(browser, server.url) as page,
    ):
        page.get_by_label("key").fill(text)
        page.get_by_role("button").click()
        page.goto("/keys")
        page.get_by_label("Scope").select_option("submit")
        page.get_by_label("For whom").fill("nightly <b>")
        page.get_by_role("button", name="Create", exact=True).click()
        made = page.locator("#new-key").inner_text()
        row = page.locator("#keys tr", has_text="nightly <b>")
        row.wait_for()
        answer = page.request.get("/api/v1/jobs", headers={"Authorization": f"Bearer {made}"})
        assert answer.status == 200
        page.reload()
        assert made not in page.content()
        row.get_by_role("button", name="Revoke").click()
        page.get_by_role("button", name="Yes").click()
        row.locator(".state.cancelled", has_text="revoked").wait_for()
        assert page.request.get("/api/v1/jobs", headers={"Authorization": f"Bearer {made}"}).status == 401
        page.locator(f"#keys tr[data-key='{first.id}']").get_by_role("button", name="Revoke").click()
        assert "the service stays locked" in page.locator("#confirm").inner_text()
        page.get_by_role("button", name="Yes").click()
        page.wait_for_url("**/login**")


def test_without_a_key_the_page_says_how_the_first_is_made(page: Page) -> None:
    page.goto("/keys")
    assert "needlebench key create --scope admin" in page.locator("main").inner_text()
    assert page.get_by_role("button", name="Create").count() == 0


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_these_pages_fit_a_phone_in_both_schemes(browser: Browser, server: Server, scheme: str) -> None:
    from tests.browser.test_pages import CONTRAST

    with opened(browser, server.url, color_scheme=scheme) as page:
        for address in ("/uploads", "/keys", "/service"):
            page.goto(address)
            for width in (390, 1440):
                page.set_viewport_size({"width": width, "height": 900})
                assert page.evaluate("document.documentElement.scrollWidth <= innerWidth"), (address, width)
            assert not page.evaluate(CONTRAST)
