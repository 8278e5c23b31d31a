"""The list of jobs in a real browser: its order, columns and groups in the address; many jobs at once; by keyboard."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

import pytest

from tests.acceptance.server import Server, until
from tests.browser.browser import PROGRAM

if TYPE_CHECKING:
    from playwright.sync_api import Locator, Page, ViewportSize

    from service.client.records import JobStatus

pytest.importorskip("playwright.sync_api", reason="needs playwright, of the dev extra")
pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(PROGRAM is None, reason="needs chromium: no chromium or chromium-browser on the PATH"),
]


def finished(server: Server, name: str, **scenario: object) -> JobStatus:
    return server.client.wait(server.client.submit({"name": name, **scenario}).id)


def names(page: Page) -> list[str]:
    return page.locator("#jobs tr[data-key] th > a").all_inner_texts()


def box(page: Page, job: JobStatus) -> None:
    """Choose a job."""
    page.locator(f"tr[data-key='{job.id}'] input[name=job]").check()


def test_order_columns_and_groups_are_kept_in_the_address(page: Page, server: Server) -> None:
    for seed, name in enumerate(("b sorted", "c sorted", "a sorted")):
        finished(server, name, seed=seed)
    campaign = server.client.start_campaign({"name": "two sorted", "grid": {"tissue.young_kpa": [3, 6.3]}})
    server.client.wait_campaign(campaign.id)
    page.goto("/?q=sorted")
    page.get_by_role("link", name="Job", exact=True).click()
    page.wait_for_url("**/?q=sorted&sort=name")
    assert names(page) == ["a sorted", "b sorted", "c sorted"]
    page.get_by_role("link", name="Job", exact=True).click()
    page.wait_for_url("**/?q=sorted&sort=name&down=1")
    assert names(page) == ["c sorted", "b sorted", "a sorted"]
    assert page.locator("th[aria-sort=descending]").count() == 1
    page.get_by_role("link", name="RMSE").click()
    page.wait_for_url("**sort=rmse")
    errors = [float(text.split()[0]) for text in page.locator("td[data-label=RMSE]").all_inner_texts()]
    assert errors == sorted(errors)
    page.get_by_text("Columns", exact=True).click()
    for column in ("Strain", "Push, N", "Lateral force, N"):
        page.get_by_role("checkbox", name=column, exact=True).uncheck()
    page.get_by_role("checkbox", name="Took").check()
    page.get_by_role("button", name="Show these").click()
    page.wait_for_url("**column=duration")
    assert "q=sorted" in page.url
    assert "sort=rmse" in page.url
    heads = page.locator("#jobs thead th").all_inner_texts()
    assert "Took" in heads
    assert "Strain" not in heads
    page.reload()
    assert page.locator("#jobs thead th").all_inner_texts() == heads
    page.get_by_text("Columns", exact=True).click()
    page.get_by_role("link", name="Show the usual ones").click()
    page.wait_for_url(re.compile(r"sort=rmse$"))
    page.get_by_label("grouped by campaign").check()
    page.wait_for_url(re.compile(r"q=sorted&group=campaign&sort=rmse"))
    page.goto("/?group=campaign")
    groups = page.locator("#jobs tbody")
    assert groups.nth(0).get_by_role("rowheader", name="Campaign two sorted").count() == 1
    assert groups.nth(0).locator("tr[data-key]").count() == 2
    assert groups.nth(1).get_by_role("rowheader", name="Single jobs").count() == 1
    page.get_by_label("with the jobs of campaigns").check()
    page.wait_for_url("**/?all=1&group=campaign")


def test_many_jobs_are_cancelled_run_again_pinned_and_deleted_at_once(page: Page, server: Server) -> None:
    running = server.client.submit({"name": "lasting of many"})
    waiting = server.client.submit({"name": "waits of many"})
    page.goto("/?q=of many")
    for job in (running, waiting):
        box(page, job)
    page.get_by_role("button", name="Cancel the chosen jobs").click()
    page.get_by_role("button", name="No", exact=True).click()
    assert server.client.job(waiting.id).state == "queued"
    page.get_by_role("button", name="Cancel the chosen jobs").click()
    page.get_by_role("button", name="Yes").click()
    page.locator("#messages", has_text="2 jobs cancelled.").wait_for()
    for job in (running, waiting):
        page.locator(f"tr[data-key='{job.id}'] .state.cancelled").wait_for()
    assert page.evaluate("document.activeElement.id") == "pick-all"
    page.get_by_label("Choose all jobs of this page").check()
    page.get_by_role("button", name="Pin the chosen jobs", exact=True).click()
    page.locator("#messages", has_text="2 jobs pinned.").wait_for()
    server.client.unpin(waiting.id)
    page.get_by_label("Choose all jobs of this page").check()
    page.get_by_role("button", name="Delete the chosen jobs").click()
    page.get_by_role("button", name="Yes").click()
    page.locator("#messages", has_text="1 job deleted, 1 job refused.").wait_for()
    assert "lasting of many: job" in page.locator("#messages li").inner_text()
    page.locator(f"tr[data-key='{waiting.id}']").wait_for(state="detached")
    assert page.locator("#picked-count").inner_text().startswith("1 chosen")  # the refused one
    page.get_by_role("button", name="Unpin the chosen jobs").click()
    page.locator("#messages", has_text="1 job no longer pinned.").wait_for()
    box(page, running)
    page.get_by_role("button", name="Retry the chosen jobs").click()
    page.get_by_role("button", name="Yes").click()
    page.locator("#messages", has_text="1 job queued again.").wait_for()
    page.locator(f"tr[data-key='{running.id}'] .state.running").wait_for()
    server.client.cancel(running.id)


def test_many_jobs_are_reached_by_the_keyboard_and_the_focus_stays(page: Page, server: Server) -> None:
    jobs = [finished(server, f"key {number}") for number in range(2)]
    page.goto("/?q=key")
    page.get_by_label("Choose all jobs of this page").focus()
    page.keyboard.press("Space")
    page.get_by_role("button", name="Pin the chosen jobs", exact=True).focus()
    page.keyboard.press("Enter")
    page.locator("#messages", has_text="2 jobs pinned.").wait_for()
    assert all(server.client.job(job.id).raw["pinned"] for job in jobs)
    page.locator("#jobs", has_text="pinned").wait_for()
    link = page.locator(f"tr[data-key='{jobs[0].id}'] th a").first
    link.focus()
    finished(server, "key that comes later")  # above the one that has the focus
    page.locator("#jobs", has_text="key that comes later").wait_for()
    assert page.evaluate("document.activeElement.closest('tr').dataset.key") == jobs[0].id
    page.keyboard.press("Enter")
    page.wait_for_url(f"**/jobs/{jobs[0].id}")


def test_a_job_is_renamed_tagged_and_found_by_its_tag(page: Page, server: Server) -> None:
    job = finished(server, "to be named")
    page.goto(f"/jobs/{job.id}")
    page.get_by_text("Name, tags, note").click()
    page.get_by_label("Name", exact=True).fill("softer <liver>")
    page.get_by_label("Tags").fill("liver, " + "x" * 41)
    page.get_by_label("Note").fill("one\ntwo")
    page.get_by_role("button", name="Save").click()
    page.locator("input[data-field=tags][aria-invalid=true]").wait_for()
    page.get_by_label("Tags").fill(" liver ,paper 2,, liver")
    page.get_by_role("button", name="Save").click()
    page.get_by_role("heading", name="softer <liver>").wait_for()
    tags = [text.split("\n")[-1] for text in page.locator("#job .tag").all_inner_texts()]
    assert tags == ["liver", "paper 2"]
    assert page.locator("#job .note").inner_text() == "one\ntwo"
    assert page.evaluate("document.activeElement.textContent") == "Save"
    server.client.edit(job.id, note="by another")
    page.get_by_label("Note").fill("mine")
    page.get_by_role("button", name="Save").click()
    page.locator("#messages", has_text="Somebody else changed this").wait_for()
    assert server.client.job(job.id).note == "by another"
    page.get_by_role("button", name="Save").click()
    page.locator("#messages", has_text="Saved.").wait_for()
    assert server.client.job(job.id).note == "mine"
    page.goto("/")
    page.get_by_label("Search for jobs").fill("PAPER")
    page.keyboard.press("Enter")
    page.wait_for_url("**/?q=PAPER")
    assert names(page) == ["softer <liver>"]
    page.locator("#jobs .tag", has_text="liver").click()
    page.wait_for_url("**/?q=PAPER&tag=liver")
    assert names(page) == ["softer <liver>"]


def displayed(row: Locator) -> str:
    """How it is laid out; nothing for one that was replaced meanwhile."""
    return row.evaluate("one => getComputedStyle(one).display")


PHONE: ViewportSize = {"width": 390, "height": 844}


def test_on_a_phone_rows_are_cards_and_submit_stays_in_reach(page: Page, server: Server) -> None:
    job = finished(server, "on a phone")
    page.set_viewport_size({"width": 640, "height": 844})
    wide = ("state", "progress", "rmse", "rcm", "push", "lateral", "drag", "strain", "stress", "submitted", "finished")
    page.goto("/?q=phone" + "".join(f"&column={name}" for name in wide))
    row = page.locator(f"tr[data-key='{job.id}']")
    place = page.locator("#jobs")
    until(lambda: displayed(row) == "table-row")
    until(lambda: place.get_attribute("tabindex") == "0")  # it is wider than the window: keys scroll it
    assert place.get_attribute("role") == "region"
    page.set_viewport_size(PHONE)
    until(lambda: place.get_attribute("tabindex") is None)
    until(lambda: displayed(row) == "block")
    cell = row.locator("td[data-label=RMSE]")
    until(lambda: cell.evaluate("one => getComputedStyle(one, '::before').content") == '"RMSE"')
    assert row.get_by_role("cell").count() > 3  # still a table for those who hear it
    page.goto("/?q=phone")
    page.get_by_label("Sorted by").select_option("rmse")
    page.wait_for_url("**/?q=phone&sort=rmse")
    page.goto("/submit")
    button = page.get_by_role("button", name="Submit", exact=True)
    for far in (0, 1500, 4000):
        page.evaluate("y => scrollTo(0, y)", far)
        box_ = button.bounding_box()
        assert box_ is not None
        assert 0 <= box_["y"] <= PHONE["height"] - box_["height"], far


def test_after_an_action_the_focus_is_where_it_was(page: Page, server: Server) -> None:
    job = finished(server, "keeps the focus")
    page.goto(f"/jobs/{job.id}")
    page.get_by_role("button", name="Pin", exact=True).focus()
    page.keyboard.press("Enter")
    page.get_by_role("button", name="Unpin").wait_for()
    assert page.evaluate("document.activeElement.textContent") == "Unpin"
    page.keyboard.press("Enter")
    page.get_by_role("button", name="Delete").wait_for()
    assert page.evaluate("document.activeElement.textContent") == "Pin"
    page.get_by_role("button", name="Delete").focus()
    page.keyboard.press("Enter")
    page.evaluate("document.dispatchEvent(new CustomEvent('changed'))")  # something happens while it is asked
    page.get_by_role("button", name="No", exact=True).press("Enter")
    page.wait_for_timeout(1500)
    assert page.evaluate("document.activeElement.textContent") == "Delete"


def test_the_cron_line_is_read_while_it_is_typed(page: Page) -> None:
    page.goto("/schedules")
    words = page.locator("#cron-words")
    until(lambda: words.inner_text().startswith("At 02:00 every day. Next: "))
    page.get_by_label("Cron line").fill("30 6 * * 1-5")
    page.locator("#cron-words", has_text="At 06:30 on Monday through Friday").wait_for()
    assert words.inner_text().count(" 06:30") == 3 + 1
    page.get_by_label("Cron line").fill("30 66 * * 1-5")
    until(lambda: words.inner_text() == "")


def test_a_link_is_not_exchanged_while_it_is_pressed(page: Page, server: Server) -> None:
    job = server.client.submit({"name": "pressed"})
    server.client.wait(job.id)
    page.locator(f"tr[data-key='{job.id}']").get_by_role("link", name="pressed").hover()
    page.mouse.down()
    arrived = server.client.submit({"name": "arrives meanwhile"})
    server.client.wait(arrived.id)
    page.wait_for_timeout(2000)  # the list would have followed by now
    assert page.locator(f"tr[data-key='{arrived.id}']").count() == 0
    page.mouse.up()
    page.wait_for_url(f"**/jobs/{job.id}")
