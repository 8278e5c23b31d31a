"""The Rerun web viewer from the installed wheel: the version that matches the recordings, without network access.

Its own server is started once, on loopback, to save its files. They are served from here without links to external
fonts, and with a policy that allows the scripts of its page by their digests. The viewer would contact its maker's
servers for news and usage statistics: the policy blocks that, and a script of ours answers first, so that the console
shows no errors.
"""

from __future__ import annotations

import base64
import gzip
import hashlib
import re
import shutil
import subprocess
import tempfile
import threading
import urllib.request
from importlib.metadata import version
from pathlib import Path
from typing import IO

from service.recording.viewer import LOOPBACK, ViewerError, environment, program

PROGRAM = "re_viewer_bg.wasm"
WASM = b"\0asm"  # how every WebAssembly program begins
FILES = {
    "index.html": "text/html; charset=utf-8",
    "re_viewer.js": "text/javascript; charset=utf-8",
    PROGRAM: "application/wasm",
    "favicon.ico": "image/x-icon",
}
QUIET = """
const original = fetch;
fetch = (resource, options) => {
  const url = new URL(resource.url ?? resource, location.href);
  const inside = url.origin === location.origin || ["blob:", "data:"].includes(url.protocol);
  return inside ? original(resource, options) : Promise.resolve(new Response(null, { status: 204 }));
};
"""
_FORM = 2  # of the files as they are stored here: after a change they are extracted again
_START_TIMEOUT_S = 60.0
_WORTH_PACKING = 10_000  # bytes
_lock = threading.Lock()


def folder(data: Path) -> Path:
    """The folder of the files, extracted from the wheel if needed. Raises ViewerError.

    Files above 10 kB are there compressed too, as NAME.gz.
    """
    home = _home(data)
    with _lock:
        if not home.is_dir():
            _extract(home)
    return home


def edition() -> str:
    """Version of the viewer and of our form of its files."""
    return f"{version('rerun-sdk')}-{_FORM}"


def extracted(data: Path) -> Path | None:
    """The folder of the files if they were extracted before."""
    home = _home(data)
    return home if home.is_dir() else None


def _home(data: Path) -> Path:
    return data / "viewer" / edition()


def _extract(home: Path) -> None:
    home.parent.mkdir(parents=True, exist_ok=True)
    draft = Path(tempfile.mkdtemp(prefix=".draft-", dir=home.parent))
    try:
        for name, content in viewer_files().items():
            (draft / name).write_bytes(_cleaned(content) if name == "index.html" else content)
            if len(content) > _WORTH_PACKING and name != "index.html":
                (draft / f"{name}.gz").write_bytes(gzip.compress(content, 5, mtime=0))
        draft.replace(home)
    except OSError as error:
        raise ViewerError(f"the files of the web viewer cannot be read or stored: {error}") from None
    finally:
        shutil.rmtree(draft, ignore_errors=True)


def viewer_files() -> dict[str, bytes]:
    """Every file as the viewer's own server sends it. Raises ViewerError, OSError."""
    arguments = ["--serve-web", "--bind", LOOPBACK, "--port", "0", "--web-viewer-port", "0"]
    process = subprocess.Popen(
        [program(), *arguments],
        env={**environment(), "NO_COLOR": "1"},
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )
    too_late = threading.Timer(_START_TIMEOUT_S, process.kill)
    too_late.start()
    try:
        assert process.stdout is not None
        url = _address(process.stdout)
        return {name: _download(f"{url}/{name}") for name in FILES}
    finally:
        too_late.cancel()
        process.kill()
        process.communicate()


def _address(output: IO[str]) -> str:
    for line in output:
        if match := re.search(rf"web-viewer at (http://{re.escape(LOOPBACK)}:\d+)", line):  # and not its other port
            return match[1]
    raise ViewerError("the web viewer did not start")


def _download(url: str) -> bytes:
    opener = urllib.request.build_opener(urllib.request.ProxyHandler({}))
    with opener.open(url, timeout=_START_TIMEOUT_S) as answer:
        content: bytes = answer.read()
    return content


def _cleaned(page: bytes) -> bytes:
    """The page without external links, without the icon that the wheel lacks, and with the script QUIET."""
    text = re.sub(r"<link\b[^>]*(https?://|apple-touch-icon)[^>]*>", "", page.decode("utf-8"))
    return text.replace("<script", f"<script>{QUIET}</script><script", 1).encode()


def policy(page: bytes) -> str:
    """Content security policy of the viewer's page: its own scripts, WebAssembly, and reading from this service."""
    scripts = re.findall(rb"<script>(.*?)</script>", page, re.DOTALL)
    digests = " ".join(f"'sha256-{base64.b64encode(hashlib.sha256(one).digest()).decode()}'" for one in scripts)
    return (
        f"default-src 'none'; script-src 'self' {digests} 'wasm-unsafe-eval'; style-src 'unsafe-inline'; "
        "img-src 'self' data: blob:; connect-src 'self' blob: data:; worker-src 'self' blob:; "
        "base-uri 'none'; form-action 'none'; frame-ancestors 'self'"
    )
