from __future__ import annotations

import re
from html.parser import HTMLParser
from pathlib import Path

from tests.service.http import finish, idle_service


class Page(HTMLParser):
    """Collects tags, and whatever could run or load."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.found: list[tuple[str, dict[str, str | None]]] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.found.append((tag, dict(attrs)))


def test_the_page_lists_jobs_and_keeps_to_its_own_policy(tmp_path: Path) -> None:
    with idle_service(tmp_path) as (http, service):
        http.post("/api/v1/jobs", json={"scenario": {"name": "mine"}})
        finish(service)
        answer = http.get("/")
    policy = answer.headers["content-security-policy"]
    nonce = re.findall(r"'nonce-([^']+)'", policy)
    assert policy.startswith("default-src 'none'")
    assert "unsafe" not in policy
    assert "on target" in answer.text
    assert "0.500 mm" in answer.text
    for tag, attributes in Page(answer.text).found:
        assert tag not in ("script", "style") or attributes["nonce"] == nonce[0]
        assert not any(name.startswith("on") or name == "style" for name in attributes)
        assert "src" not in attributes
        assert not str(attributes.get("href", "")).startswith(("http", "//"))


def test_an_empty_page_says_so(tmp_path: Path) -> None:
    with idle_service(tmp_path) as (http, _):
        assert "None yet." in http.get("/").text
