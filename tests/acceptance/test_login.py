"""A key, a real browser, a real server: the login, what its cookie opens, and what pages of elsewhere get."""

from __future__ import annotations

import shutil
import threading
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, HTTPServer
from typing import TYPE_CHECKING, Any

import pytest

from needlebench import Client
from service.settings import Settings
from service.store.database import open_database
from service.store.jobs import Store
from service.store.keys import Keys
from tests.acceptance.server import running_server

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

playwright = pytest.importorskip("playwright.sync_api")
CHROMIUM = shutil.which("chromium")

pytestmark = [pytest.mark.slow, pytest.mark.skipif(CHROMIUM is None, reason="needs Chromium")]

POST = """async (url) => {
  try {
    const body = JSON.stringify({scenario: {name: 'quick'}});
    const answer = await fetch(url, {method: 'POST', credentials: 'include', body: body,
      headers: {'Content-Type': 'application/json'}});
    return answer.status;
  } catch (error) { return 0; }
}"""
BLIND_POST = """async (url) => {
  try { await fetch(url, {method: 'POST', mode: 'no-cors', credentials: 'include', body: '{"scenario": "line"}'}); }
  catch (error) { /* what the server thinks of it is seen in its jobs */ }
}"""


class _Elsewhere(BaseHTTPRequestHandler):
    def do_GET(self) -> None:
        self.send_response(200)
        self.send_header("Content-Type", "text/html")
        self.end_headers()
        self.wfile.write(b"<title>elsewhere</title>")

    def log_message(self, *_: Any) -> None:
        """Quiet."""


@contextmanager
def elsewhere() -> Iterator[str]:
    """Another site on the same machine, which shares its cookies and not its origin."""
    server = HTTPServer(("127.0.0.1", 0), _Elsewhere)
    thread = threading.Thread(target=server.serve_forever)
    thread.start()
    try:
        yield f"http://127.0.0.1:{server.server_port}/"
    finally:
        server.shutdown()
        thread.join()
        server.server_close()


@contextmanager
def page_of_a_browser() -> Iterator[Any]:
    with playwright.sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox", "--disable-gpu"])
        try:
            yield browser.new_page()
        finally:
            browser.close()


def test_a_browser_logs_in_with_a_key_and_pages_of_elsewhere_get_nowhere(tmp_path: Path) -> None:
    store = Store(open_database(Settings(data=tmp_path).database))
    _, key = Keys(store).create(scope="submit")
    store.close()
    with running_server(tmp_path) as server, page_of_a_browser() as page, elsewhere() as other:
        page.goto(f"{server.url}/")
        assert page.url.startswith(f"{server.url}/login")
        page.get_by_label("API key").fill("wrong")
        page.keyboard.press("Enter")
        assert page.get_by_role("alert").inner_text().startswith("This key is unknown")
        page.get_by_label("API key").fill(key)
        page.get_by_role("button").click()
        page.wait_for_url(f"{server.url}/")
        (cookie,) = page.context.cookies()
        assert (cookie["httpOnly"], cookie["sameSite"]) == (True, "Strict")
        assert page.evaluate("document.cookie") == ""
        assert page.evaluate(POST, f"{server.url}/api/v1/jobs") == 202
        page.goto(other)
        assert page.evaluate(POST, f"{server.url}/api/v1/jobs") == 0
        page.evaluate(BLIND_POST, f"{server.url}/api/v1/jobs")
        with Client(server.url, key) as client:
            assert len(list(client.jobs())) == 1
