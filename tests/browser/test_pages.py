"""The pages in a real browser, over a real service whose jobs are a quick stand-in."""

from __future__ import annotations

import os
import re
from typing import TYPE_CHECKING

import pytest

from tests.acceptance.server import Server, running_server, until
from tests.browser.browser import PATIENCE_MS, PROGRAM, opened
from tests.chaos import plugin_package
from tests.service.learned import dataset_bytes

if TYPE_CHECKING:
    from collections.abc import Iterator

    from playwright.sync_api import Browser, FilePayload, Page

pytest.importorskip("playwright.sync_api", reason="needs playwright, of the dev extra")
pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(PROGRAM is None, reason="needs chromium: no chromium or chromium-browser on the PATH"),
]


LONG = "a_controller_whose_name_has_no_place_to_break_it_and_goes_on_and_on_for_almost_a_hundred_characters"


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Server]:
    folder = tmp_path_factory.mktemp("pages")
    packages = plugin_package.install(folder / "packages", LONG)
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PYTHONPATH", os.pathsep.join(filter(None, [str(packages), os.environ.get("PYTHONPATH")])))
        with running_server(folder, runner="tests.browser.runner:run_job", workers=1) as started:
            yield started


def ended(page: Page) -> None:
    """Wait until the page says that its job finished, without being loaded again."""
    page.locator("#job .state.finished").wait_for()


def test_submit_from_the_form_and_follow_to_the_end(page: Page) -> None:
    page.goto("/submit")
    page.locator("#f-name").fill("brisk from the page")
    page.get_by_label("Young").first.fill("4.5")
    page.get_by_text("JSON that will be sent").first.click()
    sent = page.locator("#json").inner_text()
    assert '"young_kpa": 4.5' in sent
    assert "poisson" not in sent
    page.get_by_role("button", name="Submit", exact=True).click()
    page.wait_for_url(re.compile("/jobs/[0-9a-z]+$"))
    page.evaluate("window.notReloaded = true")
    ended(page)
    assert page.evaluate("window.notReloaded")
    page.locator("#plot-error canvas").wait_for()
    page.locator("#plot-force canvas").wait_for()
    assert "at most" in (page.locator("#plot-error").get_attribute("aria-label") or "")
    assert page.get_by_role("row", name=re.compile("rmse_commanded_mm")).count() == 1
    assert page.get_by_role("link", name="series.npz").count() == 1
    assert page.get_by_role("row", name=re.compile("finished")).count() == 1
    page.get_by_text("Log of the last attempt").click()
    page.locator("#log pre", has_text="logged").wait_for()
    page.locator("#plot-error", has_text="depth").wait_for()
    page.get_by_label("over time").check()
    page.locator("#plot-error", has_text="time").wait_for()
    for part in ("path", "tip", "needle"):
        assert page.locator(f"#still svg .{part}").count() == 2, part
    assert "The tip ended at 18.1, 31, 30 mm." in (page.locator("#still title").text_content() or "")


def test_progress_is_told_while_it_runs_and_cancel_ends_it(page: Page, server: Server) -> None:
    job = server.client.submit({"name": "lasting to cancel"})
    page.goto(f"/jobs/{job.id}")
    until(lambda: int(page.locator("[data-step]").inner_text()) >= 20)
    page.locator("#plot-error canvas").wait_for()
    assert page.evaluate("document.querySelector('#job progress').value") > 0
    page.get_by_role("button", name="Cancel").click()
    page.get_by_role("button", name="No").click()
    assert page.locator("#job .state.running").is_visible()
    page.get_by_role("button", name="Cancel").click()
    page.get_by_role("button", name="Yes").click()
    page.locator("#job .state.cancelled").wait_for()
    assert page.get_by_role("button", name="Retry").is_visible()
    assert page.locator("#plot-error canvas").is_visible()
    page.reload()
    page.locator("#plot-error canvas").wait_for()  # what was plotted of a job that ended early stays
    assert page.evaluate("JSON.parse(document.getElementById('plots').dataset.course).length") >= 2


def test_a_live_plot_is_kept_and_only_its_data_change(page: Page, server: Server) -> None:
    """With what the reader zoomed to; a page that is open all day has no more of anything. The figure is new: into
    those of the page itself something may be drawn late."""
    job = server.client.submit({"name": "brisk to plot"})
    page.goto(f"/jobs/{job.id}")
    ended(page)
    plots = page.evaluate("performance.getEntriesByType('resource').map(e => e.name).find(n => n.includes('plots.'))")
    page.evaluate(
        """async (plots) => {
            const { draw } = await import(plots);
            const values = [];
            const figure = document.createElement("figure");
            figure.id = "own";
            figure.append(document.createElement("div"));
            document.querySelector("main").append(figure);
            window.more = () => {
                values.push(Math.sin(values.length / 9));
                const x = { label: "depth, mm", unit: "mm", range: [0, 900] };
                const series = [{ label: "a", unit: "mm", digits: 2, stroke: "--plot-1", dots: 4 }];
                const data = [values.map((_, i) => i), values];
                return draw(figure.firstChild, { data, x, series, sentence: "so far" });
            };
            window.plot = window.more();
            for (let i = 0; i < 50; i++) window.more();
        }""",
        plots,
    )
    assert page.evaluate("[plot.scales.x.min, plot.scales.x.max]") == [0, 900]
    before = listeners(page)
    assert page.evaluate("Array.from({ length: 300 }, more).every((one) => one === plot)")
    assert listeners(page) <= before
    assert page.locator("#own .uplot").count() == 1
    page.locator("#own .u-over").scroll_into_view_if_needed()
    box = page.locator("#own .u-over").bounding_box()
    assert box is not None
    page.mouse.move(box["x"] + 0.2 * box["width"], box["y"] + 50)
    page.mouse.down()
    page.mouse.move(box["x"] + 0.3 * box["width"], box["y"] + 50, steps=3)
    page.mouse.up()
    zoomed = page.evaluate("[plot.scales.x.min, plot.scales.x.max]")
    assert 100 < zoomed[0] < zoomed[1] < 350
    page.evaluate("for (let i = 0; i < 20; i++) more()")
    assert page.evaluate("[plot.scales.x.min, plot.scales.x.max]") == zoomed
    page.locator("#own .u-over").dblclick()
    page.evaluate("more()")
    assert page.evaluate("[plot.scales.x.min, plot.scales.x.max]") == [0, 900]


def listeners(page: Page) -> float:
    """How many listeners of events this page holds, after a collection of its garbage."""
    session = page.context.new_cdp_session(page)
    session.send("Performance.enable")
    session.send("HeapProfiler.collectGarbage")
    metrics = session.send("Performance.getMetrics")["metrics"]
    session.detach()
    return next(one["value"] for one in metrics if one["name"] == "JSEventListeners")


def test_jobs_are_chosen_in_the_list_and_shown_side_by_side(page: Page, server: Server) -> None:
    ids = [server.client.submit({"name": f"brisk {name}"}).id for name in ("a", "b")]
    for job in ids:
        server.client.wait(job)
    page.goto("/?q=brisk")
    page.get_by_label("Choose brisk a").check()
    assert page.locator("#side-by-side").is_hidden()
    page.get_by_label("Choose brisk b").check()
    page.evaluate("document.dispatchEvent(new CustomEvent('changed'))")  # the list is read again
    page.get_by_role("link", name="Show side by side").click()
    for name in ("error", "rcm", "force", "drag"):
        page.locator(f"#plot-{name} canvas").wait_for()
    until(lambda: "brisk b" in page.locator("#plot-force .u-legend").inner_text())
    assert "brisk a" in (page.locator("#plot-error").get_attribute("aria-label") or "")
    page.get_by_label("over time").check()
    page.locator("#plot-error", has_text="time").wait_for()


def test_the_list_follows_jobs_and_filters(page: Page, server: Server) -> None:
    job = server.client.submit({"name": "lasting in the list"})
    row = page.locator(f"tr[data-key='{job.id}']")
    row.locator(".state.running").wait_for()
    until(lambda: page.evaluate(f"document.querySelector(\"tr[data-key='{job.id}'] progress\").value") > 0.1)
    row.get_by_role("button", name="Cancel").click()
    page.get_by_role("button", name="Yes").click()
    row.locator(".state.cancelled").wait_for()
    page.get_by_role("navigation", name="Filter by state").get_by_role("link", name=re.compile("cancelled")).click()
    page.wait_for_url("**/?state=cancelled")
    assert page.locator("#jobs .state:not(.cancelled)").count() == 0


def test_an_error_is_told_in_words_and_a_job_is_deleted_after_a_question(page: Page, server: Server) -> None:
    job = server.client.submit({"name": "broken"})
    page.goto(f"/jobs/{job.id}")
    page.locator("#job .state.failed").wait_for()
    assert "with tags" in page.locator("#job .notice.bad").inner_text()
    assert page.locator("#job b").count() == 0
    page.get_by_role("button", name="Delete").click()
    page.get_by_role("button", name="No", exact=True).last.click()
    assert page.url.endswith(job.id)
    page.get_by_role("button", name="Delete").click()
    page.get_by_role("button", name="Yes").click()
    page.wait_for_url(re.compile(r":\d+/$"))
    assert page.locator(f"tr[data-key='{job.id}']").count() == 0


def test_a_grid_is_planned_run_and_compared(page: Page) -> None:
    page.goto("/campaigns")
    page.get_by_label("a grid over scenario fields").check()
    page.get_by_label("Field of axis 1").fill("controller.kind")
    page.get_by_label("Values of axis 1, separated by commas").fill("ifem, open_loop")
    page.get_by_role("button", name="Add an axis").click()
    page.get_by_label("Field of axis 2").fill("tissue.young")
    page.get_by_label("Values of axis 2, separated by commas").fill("3, 6.3")
    page.get_by_label("Name of the campaign").fill("from <the> page")
    page.get_by_role("button", name="Dry run").click()
    page.locator("#messages", has_text="young").wait_for()
    page.get_by_label("Field of axis 2").fill("tissue.young_kpa")
    page.get_by_role("button", name="Dry run").click()
    page.get_by_role("button", name="Start 4 jobs").click()
    page.wait_for_url(re.compile("/campaigns/[0-9a-z]+$"))
    page.locator("#head .state.done").wait_for()
    page.get_by_role("link", name="RMSE mm").click()
    page.locator("th[aria-sort=ascending]", has_text="RMSE").wait_for()
    page.get_by_role("button", name="Show the report here").click()
    page.frame_locator("iframe.report").locator("h1").wait_for()
    page.get_by_role("link", name="Compare", exact=True).last.click()
    page.get_by_role("button", name="Compare arms").click()
    page.get_by_role("heading", name="Result").wait_for()
    page.goto("/trends")
    page.get_by_role("link", name="from <the> page").click()
    page.locator("#plot-rmse canvas").wait_for()
    assert "marked as worse" in (page.locator("#plot-rmse").get_attribute("aria-label") or "")


def test_a_schedule_is_added_paused_run_and_deleted(page: Page) -> None:
    page.goto("/schedules")
    page.get_by_label("a grid over scenario fields").check()
    page.get_by_label("Field of axis 1").fill("tissue.young_kpa")
    page.get_by_label("Values of axis 1, separated by commas").fill("3, 6.3")
    page.get_by_label("Name", exact=True).fill("nightly")
    page.get_by_label("Cron line").fill("0 25 * * *")
    page.get_by_role("button", name="Add", exact=True).click()
    page.locator("input#cron[aria-invalid=true]").wait_for()
    page.get_by_label("Cron line").fill("0 2 * * *")
    page.get_by_role("button", name="Add", exact=True).click()
    page.get_by_role("heading", name="nightly active").wait_for()
    page.get_by_role("button", name="Pause nightly").click()
    page.get_by_role("heading", name="nightly paused").wait_for()
    page.get_by_role("button", name="Resume nightly").click()
    page.get_by_role("heading", name="nightly active").wait_for()
    page.get_by_role("button", name="Run now nightly").click()
    page.locator("#schedules .state.started").wait_for()
    page.get_by_role("button", name="Delete nightly").click()
    page.get_by_role("button", name="Yes").click()
    page.locator("#schedules section").wait_for(state="detached")


def test_a_model_is_trained_from_the_page_and_steered_by(page: Page) -> None:
    page.goto("/models")
    page.get_by_role("button", name="Train", exact=True).click()
    page.locator("[data-field=data][aria-invalid=true]").wait_for()
    file: FilePayload = {"name": "data.npz", "mimeType": "application/octet-stream", "buffer": b"no data set"}
    page.get_by_label("Upload one").set_input_files(files=[file])
    page.locator(".field:has(#file) .problem", has_text="cannot be used as a data set").wait_for()  # beside its field
    file["buffer"] = dataset_bytes()
    page.get_by_label("Upload one").set_input_files(files=[file])
    page.locator(".field:has(#file)", has_text="data.npz is here").wait_for()
    assert "80 rows, 2 insertions" in page.locator("#data option:checked").inner_text()
    page.get_by_label("Kind").select_option("linear")
    assert not page.get_by_label("Nodes").is_visible()
    page.get_by_label("Kind").select_option("elm")
    page.get_by_label("Nodes").fill("2.5")
    page.get_by_label("Name").fill("from the page")
    page.get_by_role("button", name="Train", exact=True).click()
    page.locator("[data-field=nodes][aria-invalid=true]").wait_for()
    page.get_by_label("Nodes").fill("12")
    page.get_by_role("button", name="Train", exact=True).click()
    page.wait_for_url(re.compile("/jobs/[0-9a-z]+$"))
    ended(page)
    page.get_by_role("link", name="Open the model").click()
    page.wait_for_url("**/models/*")
    page.get_by_role("heading", name="from the page.json").wait_for()
    assert page.locator(".errors rect").count() == 6
    page.get_by_role("button", name="Pin", exact=True).click()
    page.get_by_role("button", name="Unpin").click()
    page.get_by_role("button", name="Delete").wait_for()
    page.get_by_role("link", name="Steer by it").click()
    page.get_by_role("button", name="Submit", exact=True).click()
    page.wait_for_url(re.compile("/jobs/[0-9a-z]+$"))
    page.goto("/models")
    page.get_by_role("link", name="from the page.json").first.click()
    page.locator("#used tbody tr").wait_for()


def test_the_keyboard_reaches_the_main_actions_in_order(page: Page) -> None:
    reached = []
    for _ in range(12):
        page.keyboard.press("Tab")
        reached.append(page.evaluate("document.activeElement.textContent.trim()"))
        outline = page.evaluate("getComputedStyle(document.activeElement).outlineStyle")
        assert outline != "none", reached
    assert reached[:11] == [
        "Skip to the content",
        "needlebench",
        "Jobs",
        "Submit",
        "Campaigns",
        "Schedules",
        "Trends",
        "Compare",
        "Models",
        "Service",
        "Submit a job",
    ]
    page.goto("/submit")
    page.keyboard.press("Tab")
    page.keyboard.press("Enter")
    page.keyboard.press("Tab")
    assert page.evaluate("document.activeElement.id") == "preset"
    page.keyboard.press("Tab")
    page.keyboard.press("Tab")
    page.keyboard.type("brisk by keys")
    page.keyboard.press("Enter")
    page.wait_for_url(re.compile("/jobs/[0-9a-z]+$"))


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_text_has_contrast_light_and_dark_and_nothing_overflows(browser: Browser, server: Server, scheme: str) -> None:
    done, broken = (server.client.wait(server.client.submit({"name": name}).id).id for name in ("quick", "broken"))
    with opened(browser, server.url, color_scheme=scheme) as page:
        lists = ("/", "/submit", "/campaigns", "/schedules", "/compare", "/models", "/models/elm")
        for address in (*lists, f"/jobs/{done}", f"/jobs/{broken}"):
            page.goto(address)
            for width in (1280, 800):
                page.set_viewport_size({"width": width, "height": 720})
                assert page.evaluate("document.documentElement.scrollWidth <= innerWidth"), (address, width)
            faint = page.evaluate(CONTRAST)
            assert not faint, (address, scheme, faint)
        background = page.evaluate("getComputedStyle(document.body).backgroundColor")
        assert (sum(map(int, re.findall(r"\d+", background)[:3])) < 200) == (scheme == "dark")


def test_long_names_make_no_page_scroll_sideways_and_wide_tables_do_so_by_keys(page: Page, server: Server) -> None:
    arms = [{"kind": "ifem"}, {"kind": "plugin", "name": LONG, "settings": {"does": "nothing"}}]
    grid = {"controller": arms, "trajectory.target_mm": [[18, 31, 30], [18, 31, 31]]}
    campaign = server.client.start_campaign({"name": LONG, "grid": grid})
    server.client.wait_campaign(campaign.id)
    for address in (f"/compare?a={campaign.id}&every=1", f"/campaigns/{campaign.id}", f"/trends/{LONG}"):
        page.goto(address)
        page.evaluate("for (const one of document.querySelectorAll('details')) one.open = true")
        for width in (390, 1440):
            page.set_viewport_size({"width": width, "height": 900})
            assert page.evaluate("document.documentElement.scrollWidth <= innerWidth"), (address, width)
        page.set_viewport_size({"width": 640, "height": 900})  # wider than where rows become cards
        table = page.locator(".table[role=region][tabindex='0']").first
        table.focus()
        for _ in range(5):
            page.keyboard.press("ArrowRight")
        until(lambda: page.evaluate("document.activeElement.scrollLeft > 0"))


def test_a_service_that_is_away_is_told(browser: Browser, server: Server) -> None:
    with opened(browser, server.url, expected="net::ERR_FAILED") as page:
        page.goto("/submit")
        page.route("**/api/v1/jobs", lambda route: route.abort())
        page.get_by_role("button", name="Submit", exact=True).click()
        page.locator("#messages", has_text="does not respond").wait_for()


def test_the_viewer_follows_a_recording_and_can_reach_nothing_else(browser: Browser, server: Server) -> None:
    """Nothing on the console but what it warns of: a picture by software, and calls of a window that a page has not."""
    job = server.client.submit({"name": "recorded"})
    with opened(browser, server.url, expected="WARN|deprecated parameters|No available adapters|GPU") as page:
        page.goto(f"/jobs/{job.id}")
        ended(page)
        with page.expect_response(re.compile(f"/recordings/{job.id}.rrd")) as answer:
            page.get_by_role("button", name="Open recording").click()
            page.frame_locator("iframe.viewer").locator("canvas.visible").wait_for(timeout=3 * PATIENCE_MS)
        assert answer.value.status == 200
        answer.value.finished()  # waits for the last byte


# Texts whose contrast against what is behind them is below 4.5 to 1 (WCAG 2.2, 1.4.3).
CONTRAST = """
() => {
  const rgb = (text) => (text.match(/[\\d.]+/g) || []).map(Number);
  const opaque = (v) => v.length === 3 || v[3] > 0;
  const linear = (c) => c <= 0.04045 ? c / 12.92 : ((c + 0.055) / 1.055) ** 2.4;
  const light = (v) => [0.2126, 0.7152, 0.0722].reduce((sum, w, i) => sum + w * linear(v[i] / 255), 0);
  const behind = (e) => {
    for (; e; e = e.parentElement) {
      const colour = rgb(getComputedStyle(e).backgroundColor);
      if (opaque(colour)) return colour;
    }
    return [255, 255, 255];
  };
  const found = [];
  for (const e of document.querySelectorAll("body *")) {
    const own = [...e.childNodes].some((n) => n.nodeType === 3 && n.textContent.trim());
    if (!own || !e.checkVisibility() || e.closest(":disabled, svg, .unseen, .skip, option")) continue;
    const [a, b] = [light(rgb(getComputedStyle(e).color)), light(behind(e))].sort((x, y) => y - x);
    if ((a + 0.05) / (b + 0.05) < 4.5) found.push(e.textContent.trim().slice(0, 40));
  }
  return found;
}
"""
