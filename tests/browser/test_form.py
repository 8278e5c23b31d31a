"""The form of a job in a real browser: what it refuses, draws, estimates and keeps."""

from __future__ import annotations

import json
import re
from typing import TYPE_CHECKING, Any

import pytest

from tests.browser.browser import PROGRAM

if TYPE_CHECKING:
    from playwright.sync_api import Page, Route

    from tests.acceptance.server import Server

pytest.importorskip("playwright.sync_api", reason="needs playwright, of the dev extra")
pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(PROGRAM is None, reason="needs chromium: no chromium or chromium-browser on the PATH"),
]


def test_wrong_fields_are_marked_at_their_place(page: Page) -> None:
    page.goto("/submit?from=demo")
    page.locator("details[data-group=needle] > summary").click()
    page.get_by_label("Inner diameter").fill("9")
    page.get_by_label("Target z").fill("500")
    page.get_by_role("button", name="Submit", exact=True).click()
    wrong = page.locator("[data-path='needle.inner_diameter_mm']")
    wrong.locator(".problem").wait_for()
    assert page.get_by_label("Inner diameter").get_attribute("aria-invalid") == "true"
    assert page.evaluate("document.activeElement.id") == "f-needle-inner_diameter_mm"
    assert "field" in page.locator("#messages").inner_text()
    page.get_by_label("Inner diameter").fill("")
    page.get_by_role("button", name="Submit", exact=True).click()
    page.locator("[data-path='trajectory.target_mm'] .problem").wait_for()
    assert page.locator(".problem").count() == 1
    page.get_by_label("Target z").fill("")
    page.get_by_label("Poisson").first.press_sequentially("1e")  # no number: not to be taken for an empty field
    page.get_by_role("button", name="Submit", exact=True).click()
    page.locator("[data-path='tissue.poisson'] .problem").wait_for()


def test_the_drawing_and_the_estimate_follow_the_form(page: Page) -> None:
    page.goto("/submit")
    before = page.locator("#drawing title").text_content()
    page.get_by_label("Target z").fill("60")
    assert page.locator("#drawing title").text_content() != before
    assert "60.0 mm, 600 steps" in page.locator("#length").inner_text()
    page.locator("#estimate", has_text=re.compile("About .* between .* and ")).wait_for()
    focus = page.evaluate("document.activeElement.id")
    page.get_by_label("Target z").fill("500")
    page.locator("[data-path='trajectory.target_mm'] .problem").wait_for()  # before anything was submitted
    assert page.evaluate("document.activeElement.id") == focus
    assert page.locator("#messages .notice").count() == 0
    page.get_by_label("Target z").fill("60")
    page.locator("[data-path='trajectory.target_mm'] .problem").wait_for(state="detached")
    page.get_by_label("Kind").first.select_option("sine")
    page.get_by_label("Amplitude").first.fill("5")
    assert len((page.locator("#drawing .path").first.get_attribute("points") or "").split()) > 100
    page.get_by_role("button", name="Clear").click()
    assert page.locator("#drawing title").text_content() == before


def test_a_scenario_survives_the_form(page: Page, server: Server) -> None:
    """Started from a job, sent unchanged: the same scenario comes out."""
    fields = {
        "name": "there and back",
        "seed": 5,
        "trajectory": {"kind": "sine", "amplitude_mm": 2.0, "direction": [0, 1, 0]},
        "controller": {"kind": "ifem", "jacobian": "perturbation", "model": {"kind": "separate", "young_kpa": 5.0}},
        "motion": {"kind": "breathing"},
        "tissue": {"fixed_faces": ["z_max"]},
        "recording": {"enabled": False},
    }
    job = server.client.submit(fields)
    page.goto(f"/submit?from={job.id}")
    page.get_by_role("button", name="Submit", exact=True).click()
    page.wait_for_url(re.compile("/jobs/[0-9a-z]+$"))
    again = page.evaluate("fetch('/api/v1' + location.pathname).then((r) => r.json())")
    assert again["id"] != job.id
    assert again["scenario"] == page.evaluate(f"fetch('/api/v1/jobs/{job.id}').then((r) => r.json())")["scenario"]


def test_a_form_is_submitted_only_once_its_script_is_here(page: Page) -> None:
    held: list[Route] = []

    def hold(route: Route) -> None:
        held.append(route)

    page.route("**/submit.js*", hold)
    page.goto("/submit", wait_until="commit")
    submit = page.get_by_role("button", name="Submit", exact=True)
    assert submit.is_disabled()
    page.locator("#f-name").press("Enter")
    assert page.url.endswith("/submit")
    held[0].continue_()
    page.locator("button[type=submit]:enabled").wait_for()
    page.locator("#f-name").fill("brisk after the script")
    submit.click()
    page.wait_for_url(re.compile("/jobs/[0-9a-z]+$"))
    page.get_by_role("heading", name="brisk after the script").wait_for()


def test_what_was_entered_survives_a_reload_and_is_not_replaced_unasked(page: Page) -> None:
    page.goto("/submit?from=line")
    page.locator("#f-name").fill("brisk and kept")
    page.get_by_text("priority and time limit").click()
    page.locator("#f-priority").fill("-3")
    page.reload()
    assert page.locator("#f-name").input_value() == "brisk and kept"
    assert page.locator("#f-priority").input_value() == "-3"
    assert page.locator("#preset").input_value() == "line"
    page.locator("#preset").select_option("sine")
    page.get_by_role("dialog").get_by_text("Replace what you entered by sine?").wait_for()
    page.get_by_role("button", name="No").click()
    assert page.locator("#f-name").input_value() == "brisk and kept"
    assert page.locator("#preset").input_value() == "line"
    page.locator("#preset").select_option("sine")
    page.get_by_role("button", name="Yes").click()
    page.wait_for_function("document.getElementById('f-name').value !== 'brisk and kept'")
    page.locator("#preset").select_option("demo")  # nothing was entered since: nobody asks
    page.reload()
    assert page.locator("#preset").input_value() == "line"
    assert not page.locator("#f-priority").is_visible()


@pytest.mark.parametrize(
    "region",
    [
        {"kind": "box", "min_mm": [0, 0, 100], "max_mm": [36, 10, 127]},
        {"kind": "sphere", "centre_mm": [18, 60, 60], "radius_mm": 12},
        {"kind": "plane", "point_mm": [0, 0, 120], "normal": [0, 0, 1], "within_mm": 3},
    ],
    ids=lambda region: region["kind"],
)
def test_the_form_draws_the_regions_that_are_held(page: Page, region: dict[str, Any]) -> None:
    page.goto("/submit")
    page.locator("#drawing .held").first.wait_for(state="attached")
    entered(page, "tissue.fixed_regions", json.dumps([region]))
    assert page.locator("#drawing .region").count() == 2
    assert page.locator("#drawing .held").count() == 0  # the faces of the default are held where nothing else is
    assert "held: 1 region." in (page.locator("#drawing title").text_content() or "")


def test_a_path_that_leaves_the_block_is_drawn_so(page: Page) -> None:
    page.goto("/submit")
    page.locator("#drawing .path").first.wait_for(state="attached")
    assert page.locator("#drawing .beyond[points='']").count() == 2
    entered(page, "trajectory.target_mm", "90")
    assert page.locator("#drawing .beyond:not([points=''])").count() == 2
    assert "which leaves the block" in (page.locator("#drawing title").text_content() or "")


def entered(page: Page, path: str, text: str) -> None:
    """Type into the first input of a field, whether its part of the form is open or not."""
    page.locator(f'[data-path="{path}"]').evaluate(
        """(field, text) => {
            const control = field.querySelector("input, textarea");
            control.value = text;
            control.dispatchEvent(new Event("input", { bubbles: true }));
        }""",
        text,
    )
