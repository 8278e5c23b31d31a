"""Behind a proxy that shows the service under a path of its own: pages, redirects, streams, files and commands."""

from __future__ import annotations

import re
import socket
from typing import TYPE_CHECKING
from urllib.parse import urljoin, urlsplit

import httpx2
import pytest

from needlebench import Client
from service.environment import SettingsError
from service.settings import Settings
from tests.acceptance.server import running_server
from tests.service.http import idle_service
from tests.service.server.reverse_proxy import proxy_of, upstream_of

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from starlette.testclient import TestClient

PREFIX = "/lab/needles"
KEY = "correct-horse"
PUBLIC = f"https://lab.example{PREFIX}"
ADDRESS = re.compile(r'\b(?:href|src|action|data-action|data-url|data-goto)="([^"#?][^"]*)"')


def free_port() -> int:
    with socket.create_server(("127.0.0.1", 0)) as listener:
        return int(listener.getsockname()[1])


@pytest.mark.slow
@pytest.mark.parametrize(("strips", "keeps_host"), [(True, True), (False, False)], ids=["nginx", "passes on"])
def test_a_service_works_behind_a_proxy_under_a_path(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, strips: bool, keeps_host: bool
) -> None:
    monkeypatch.setenv("NEEDLEBENCH_API_KEY", KEY)
    port = free_port()
    public = f"http://127.0.0.1:{port}{PREFIX}"
    with (
        running_server(tmp_path, workers=1, api_key=KEY, public_url=public) as server,
        proxy_of(port, upstream=upstream_of(server.url), prefix=PREFIX, strips=strips, keeps_host=keeps_host),
        httpx2.Client(trust_env=False, timeout=60) as browser,
        Client(public, api_key=KEY) as client,
    ):
        job = client.submit({"name": "quick"})
        assert [event.kind for event in client.events(job.id) if event.kind != "progress"][-1] == "finished"
        sent_on = browser.get(f"{public}/submit", headers={"Accept": "text/html"})
        assert sent_on.headers["location"] == f"{PREFIX}/login?next=%2Fsubmit"
        origin = f"http://127.0.0.1:{port}"
        form = {"key": KEY, "next": "/submit"}
        entered = browser.post(f"{public}/login", data=form, headers={"Origin": origin})
        assert entered.headers["location"] == f"{PREFIX}/submit"
        assert f"path={PREFIX}/" in entered.headers["set-cookie"].lower().replace("; ", ";")
        seen: set[str] = set()
        for page in ("/", "/submit", "/campaigns", "/schedules", "/models", f"/jobs/{job.id}"):
            seen |= addresses_of(browser, public + page)
        assert f"{PREFIX}/recordings/{job.id}.rrd" in seen
        told = browser.post(f"{public}/api/v1/jobs", json={"scenario": {"name": "quick"}}, headers={"Origin": origin})
        assert (told.status_code, told.headers["location"]) == (202, f"{PREFIX}/api/v1/jobs/{told.json()['id']}")
        assert browser.get(urljoin(public, told.json()["links"]["self"])).json()["id"] == told.json()["id"]
        foreign = browser.post(f"{public}/api/v1/jobs", json={}, headers={"Origin": "https://lab.example"})
        assert (foreign.status_code, foreign.json()["code"]) == (403, "origin-foreign")
        assert browser.get(f"{public}/viewer/").headers["location"] == f"{PREFIX}/viewer/index.html"
        assert browser.get(f"{public}/recordings/{job.id}.rrd").content.startswith(b"step 1")


def addresses_of(browser: httpx2.Client, url: str) -> set[str]:
    """Every address of a page, each of which leads somewhere under the proxy's path."""
    page = browser.get(url)
    assert page.status_code == 200, page.text
    assert f'data-root="{PREFIX}"' in page.text
    found = set(ADDRESS.findall(page.text))
    assert all(address.startswith(f"{PREFIX}/") for address in found), found
    for address in found:
        if "/static/" in address:
            assert browser.get(urljoin(url, address)).status_code == 200, address
    return found


@pytest.fixture
def behind(tmp_path: Path) -> Iterator[TestClient]:
    with idle_service(tmp_path, api_key=KEY, public_url=PUBLIC) as (http, _):
        http.headers["Authorization"] = f"Bearer {KEY}"
        http.follow_redirects = False
        yield http


def test_the_name_that_a_proxy_shows_is_the_service_s_own_and_no_other(behind: TestClient) -> None:
    assert behind.get("/readyz", headers={"Host": "lab.example"}).status_code in (200, 503)
    assert behind.get("/readyz", headers={"Host": "evil.example"}).status_code == 421
    for path in (PREFIX, f"{PREFIX}/", "/"):
        assert f'href="{PREFIX}/campaigns"' in behind.get(path, headers={"Host": "lab.example"}).text
    assert behind.get(f"{PREFIX}x/", headers={"Host": "lab.example"}).status_code == 404


def test_every_address_in_a_script_takes_the_proxy_s_path() -> None:
    from service.web import assets

    for name, content in assets.files().items():
        if name.endswith(".js") and "vendor/" not in name:
            for line in content.decode().splitlines():
                for found in re.finditer(r"(.{3})[\"`]/(?:[a-z]+[/\"?`]|api/)", line):
                    assert found[1].endswith("at("), f"{name}: {line.strip()}"


def test_a_service_behind_a_proxy_needs_a_key(tmp_path: Path) -> None:
    with pytest.raises(SettingsError, match="needs a key"):
        Settings(data=tmp_path, public_url=PUBLIC).check_exposure()
    with idle_service(tmp_path, public_url=PUBLIC) as (http, _):
        assert http.get("/api/v1/jobs").status_code == 401


@pytest.mark.parametrize(
    "url",
    ["lab.example", "ftp://a", "https://a/b c", "https://a/../b", "https://a//b", "https://a/jobs", "https://a/api/x",
     'https://a/"', "https://a/b?c", "javascript:alert(1)", "https://u@a/"],
)  # fmt: skip
def test_an_address_that_no_proxy_shows_is_refused(url: str) -> None:
    with pytest.raises(SettingsError, match="NEEDLEBENCH_PUBLIC_URL"):
        Settings(public_url=url)


def test_a_path_is_known_from_its_address() -> None:
    assert Settings(public_url="https://Lab.example:8443/needles/").root_path == "/needles"
    assert Settings(public_url="https://Lab.example:8443/needles/").public_host == "lab.example:8443"
    assert Settings(public_url="https://lab.example").root_path == ""
    assert urlsplit(PUBLIC).path == Settings(public_url=PUBLIC).root_path
