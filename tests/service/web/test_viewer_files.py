"""The viewer in the page: its own policy, no link to elsewhere; scripts and vendored files are whole."""

import re
from pathlib import Path

import pytest

from service.recording import web_viewer as viewer_files
from service.web import assets
from tests.service.http import idle_service


def test_scripts_import_files_that_are_there_and_nothing_from_elsewhere() -> None:
    for name, content in assets.files().items():
        if name.startswith("vendor/") or not name.endswith(".js"):
            continue
        text = content.decode()
        for wanted in re.findall(r'from "\./([^"]+)"', text):
            assert wanted in assets.files(), (name, wanted)
        assert not re.search(r"\b(eval|innerHTML|insertAdjacentHTML|document\.write)\b", text), name
        assert set(re.findall(r"https?://[\w.]+", text)) <= {"http://www.w3.org"}, name


def test_vendored_files_come_with_their_licence() -> None:
    folders = {path.parent for path in (assets.FOLDER / "vendor").rglob("*.js")}
    notice = (assets.FOLDER / "vendor" / "NOTICE").read_text()
    for folder in folders:
        assert "Permission is hereby granted" in (folder / "LICENSE").read_text()
        assert folder.name in notice.lower()
        version = re.search(r"\(v([\d.]+)\)", next(folder.glob("*.js")).read_text()[:200])
        assert version is not None
        assert version[1] in notice


# ---- the viewer


@pytest.mark.slow
def test_the_viewer_has_its_own_policy_and_no_link_to_elsewhere(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    page = (
        b'<html><link rel="preconnect"\n href="https://fonts.example" crossorigin />'
        b'<link rel="icon" href="favicon.ico">'
        b"<script>let one = 1;</script><script src='re_viewer.js'></script></html>"
    )
    content = dict.fromkeys(viewer_files.FILES, b"x" * 20_000) | {"index.html": page}
    monkeypatch.setattr(viewer_files, "viewer_files", lambda: content)
    with idle_service(tmp_path) as (http, _):
        answer = http.get("/viewer/index.html")
        assert "fonts" not in answer.text
        assert answer.text.index(viewer_files.QUIET) < answer.text.index("let one")
        assert "favicon.ico" in answer.text
        policy = answer.headers["content-security-policy"]
        assert "script-src 'self' 'sha256-" in policy
        assert "frame-ancestors 'self'" in policy
        assert not re.search(r"https?:|script-src[^;]*unsafe-inline", policy)
        packed = http.get("/viewer/re_viewer_bg.wasm")
        assert packed.headers["content-encoding"] == "gzip"
        assert packed.headers["rerun-final-length"] == "20000"
        assert packed.content == content["re_viewer_bg.wasm"]
        plain = http.get("/viewer/re_viewer_bg.wasm", headers={"Accept-Encoding": "identity"})
        assert "content-encoding" not in plain.headers
        assert plain.headers["content-type"] == "application/wasm"
        assert http.get("/viewer/index.html", headers={"If-None-Match": answer.headers["etag"]}).status_code == 304
        assert http.get("/viewer/sw.js").status_code == 404


@pytest.mark.slow
def test_the_installed_viewer_is_taken_out_whole(tmp_path: Path) -> None:
    home = viewer_files.folder(tmp_path)
    assert {path.name for path in home.iterdir()} >= viewer_files.FILES.keys()
    assert (home / "re_viewer_bg.wasm").read_bytes()[:4] == b"\0asm"
    page = (home / "index.html").read_bytes()
    assert b"<link" in page
    assert not re.search(rb"<link[^>]*https?:", page)
    assert viewer_files.policy(page).count("'sha256-") == page.count(b"<script>") > 0
    assert viewer_files.folder(tmp_path) == home
