"""Pictures of campaigns in a real browser, over results that were put into the store."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Any

import pytest

from tests.acceptance.server import Server, running_server
from tests.browser.browser import PROGRAM, opened
from tests.browser.stored import Measured, by_stiffness_and_gain, end_all
from tests.service.http import idle_service

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from playwright.sync_api import Browser, Page

pytest.importorskip("playwright.sync_api", reason="needs playwright, of the dev extra")
pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(PROGRAM is None, reason="needs chromium: no chromium or chromium-browser on the PATH"),
]

TWO_AXES = {
    "name": "stiffness and gain",
    "grid": {"controller.gain": [0.5, 1.0, 1.5], "tissue.young_kpa": [3, 6, 9, 12]},
}
THREE_AXES = {
    "name": "three axes",
    "scenario": {"noise_mm": 0.1},
    "grid": {"controller.kind": ["ifem", "frozen", "open_loop"], "tissue.young_kpa": [3, 6, 9], "seed": [0, 1]},
}


HISTORY = {
    "name": "every night",
    "scenario": {"noise_mm": 0.1},
    "grid": {"controller.kind": ["ifem", "open_loop"], "seed": [0, 1, 2]},
}


def worse_from_the_fourth(run: int) -> Callable[[dict[str, Any]], Measured | None]:
    def measure(scenario: dict[str, Any]) -> Measured | None:
        known = by_stiffness_and_gain(scenario)
        assert known is not None
        return {**known, "rmse_commanded_mm": known["rmse_commanded_mm"] * (1.2 if run >= 3 else 1.0)}

    return measure


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Server, dict[str, str]]]:
    """A service whose campaigns have ended, and their ids by name."""
    folder, made = tmp_path_factory.mktemp("pictures"), {}
    with idle_service(folder) as (http, service):
        for body in (TWO_AXES, THREE_AXES):
            made[str(body["name"])] = http.post("/api/v1/campaigns", json=body).json()["id"]
            end_all(service, by_stiffness_and_gain)
        for run in range(6):
            http.post("/api/v1/campaigns", json=HISTORY)
            end_all(service, worse_from_the_fourth(run))
    with running_server(folder, runner="tests.browser.runner:run_job", workers=1) as server:
        yield server, made


@pytest.fixture
def page(browser: Browser, site: tuple[Server, dict[str, str]]) -> Iterator[Page]:
    with opened(browser, site[0].url) as found:
        yield found


def test_two_axes_are_a_table_of_shaded_values_that_lead_to_the_insertions(
    page: Page, site: tuple[Server, dict[str, str]]
) -> None:
    page.goto(f"/campaigns/{site[1]['stiffness and gain']}")
    table = page.locator("table.heat")
    assert table.locator("tbody tr").count() == 4
    assert table.locator("thead th").all_inner_texts() == ["tissue.young_kpa", "0.5", "1.0", "1.5"]
    expected = by_stiffness_and_gain(
        {"tissue": {"young_kpa": 6}, "controller": {"kind": "ifem", "gain": 0.5}, "seed": 0}
    )
    assert expected is not None
    cell = table.locator("tbody tr").nth(1).locator("td").first
    assert cell.inner_text() == f"{expected['rmse_commanded_mm']:.3f}"
    shades = [set((cell.get_attribute("class") or "").split()) - {"n"} for cell in table.locator("td").all()]
    assert shades[-1] == set()  # the corner that failed has a word and no shade
    assert table.locator("td").last.inner_text() == "failed"
    assert {"heat-0"} in shades
    assert {"heat-6"} in shades
    page.get_by_label("Value", exact=True).select_option("push")
    page.get_by_role("button", name="Show", exact=True).click()
    page.locator("table.heat caption", has_text="Push, N").wait_for()
    page.locator("table.heat tbody tr").nth(2).locator("td a").nth(1).click()
    page.wait_for_url(re.compile("/jobs/[0-9a-z]+$"))
    assert page.locator("h1", has_text="E 9").count() == 1


def test_more_axes_are_points_over_what_is_chosen_and_a_click_leads_to_the_insertion(
    page: Page, site: tuple[Server, dict[str, str]]
) -> None:
    page.goto(f"/campaigns/{site[1]['three axes']}")
    assert page.locator(".points [data-job]").count() == 18
    assert page.locator(".marks li").all_inner_texts() == ["arm:", "frozen", "ifem", "open_loop"]
    page.get_by_label("Across", exact=True).select_option("rcm")
    page.get_by_label("Colour", exact=True).select_option("rmse")
    page.get_by_role("button", name="Show", exact=True).click()
    page.wait_for_url(re.compile("x=rcm"))
    drawing = page.locator(".points svg")
    assert "RMSE, mm over RCM error, mm, coloured by RMSE, mm" in (drawing.get_attribute("aria-label") or "")
    sizes = page.evaluate(
        "[...document.querySelectorAll('.points [data-job]')]"
        ".map((e) => [e.getBBox().width, +e.textContent.split(', ').at(-1)])"
    )
    smallest, largest = (choose(sizes, key=lambda one: one[1]) for choose in (min, max))
    assert smallest[0] < largest[0]
    page.get_by_text("The points as a table").click()
    assert page.locator("details[open] tbody tr").count() == 18
    last = page.locator(".points [data-job]").last  # on top of the others
    job = last.get_attribute("data-job")
    last.click()
    page.wait_for_url(f"**/jobs/{job}")


def test_arms_are_placed_by_error_and_cost_and_the_beaten_ones_are_named(
    page: Page, site: tuple[Server, dict[str, str]]
) -> None:
    page.goto(f"/campaigns/{site[1]['three axes']}")
    pictures = page.locator("section[aria-labelledby=fronts-title] figure")
    assert pictures.count() == 2
    for picture in pictures.all():
        assert picture.locator("figcaption").inner_text() == (
            "On the front: I-FEM, frozen Jacobian. open loop is beaten by I-FEM."
        )
        assert picture.locator("path.hollow").count() == 1
        assert picture.locator("path.front").count() == 1


def test_a_suite_has_profiles_by_arm_and_its_history_with_the_step_marked(page: Page) -> None:
    page.goto("/suites")
    page.get_by_role("link", name="every night").click()
    page.get_by_role("heading", name="Profiles of the latest campaign").wait_for()
    assert page.locator(".marks li").all_inner_texts() == ["Arm:", "I-FEM", "open loop"]
    assert page.locator(".points path.line").count() == 2
    card = page.locator(".multiples .card", has=page.get_by_role("heading", name="RMSE, mm, median"))
    assert card.locator("path.step.worse").count() == 1
    assert "worse since" in card.locator("figcaption").inner_text()
    push = page.locator(".multiples .card", has=page.get_by_role("heading", name="Push, N"))
    assert push.locator("path.step").count() == 0
    assert push.locator("figcaption").inner_text().endswith("no step.")
    card.get_by_role("link", name="the campaign with the step").click()
    page.get_by_role("heading", name="every night done").wait_for()


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_pictures_fit_a_phone_in_both_schemes(
    browser: Browser, site: tuple[Server, dict[str, str]], scheme: str
) -> None:
    from tests.browser.test_pages import CONTRAST

    with opened(browser, site[0].url, color_scheme=scheme) as page:
        compared = f"/compare?a={site[1]['three axes']}&every=1"
        campaigns = [f"/campaigns/{campaign}" for campaign in site[1].values()]
        for address in (*campaigns, compared, "/suites", "/suites/every night"):
            page.goto(address)
            for width in (390, 1440):
                page.set_viewport_size({"width": width, "height": 900})
                assert page.evaluate("document.documentElement.scrollWidth <= innerWidth"), (address, width)
            assert not page.evaluate(CONTRAST)
