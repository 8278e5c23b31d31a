"""A real Chromium over a real service; each page remembers what its console complained about."""

from __future__ import annotations

import re
import shutil
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Iterator

    from playwright.sync_api import Browser, Page

PROGRAM = shutil.which("chromium") or shutil.which("chromium-browser")
ARGUMENTS = [
    "--headless",
    "--no-sandbox",
    "--use-angle=swiftshader",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
]
PATIENCE_MS = 30_000
REFUSAL = "the server responded with a status of"


@contextmanager
def chromium() -> Iterator[Browser]:
    """The browser, until the block ends."""
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=PROGRAM, args=ARGUMENTS)
        try:
            yield browser
        finally:
            browser.close()


@contextmanager
def opened(browser: Browser, url: str, *, expected: str = REFUSAL, **context: Any) -> Iterator[Page]:
    """A fresh window at `url`. On leaving: nothing was blocked, broken or asked of elsewhere.

    expected: pattern of messages on the console that are no complaint; by default errors that the service answered.
    """
    window = browser.new_context(base_url=url, viewport={"width": 1280, "height": 720}, **context)
    window.set_default_timeout(PATIENCE_MS)
    page = window.new_page()
    complaints: list[str] = []

    def heard(kind: str, text: str) -> None:
        if kind in ("error", "warning") and not re.search(expected, text):
            complaints.append(text)

    page.on("console", lambda message: heard(message.type, message.text))
    page.on("pageerror", lambda error: complaints.append(str(error)))
    page.on("request", lambda request: None if _inside(request.url, url) else complaints.append(request.url))
    try:
        page.goto("/")
        yield page
    finally:
        window.close()
    assert not complaints, "\n".join(complaints)


def _inside(address: str, url: str) -> bool:
    return address.startswith((f"{url}/", "data:", "blob:"))
