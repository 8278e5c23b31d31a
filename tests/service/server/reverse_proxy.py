"""A reverse proxy: shows a service under a path of its own, as nginx and others do."""

from __future__ import annotations

import http.client
import threading
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import TYPE_CHECKING, Any
from urllib.parse import urlsplit

if TYPE_CHECKING:
    from collections.abc import Iterator


class Proxy(BaseHTTPRequestHandler):
    """Forwards what is asked for below `prefix`, one connection a request, and passes on each piece as it arrives."""

    upstream, prefix, strips, keeps_host = "", "", True, True

    def forward(self) -> None:
        """Ask the service, give its answer."""
        if not self.path.startswith(f"{self.prefix}/"):
            self.send_error(404)
            return
        path = self.path[len(self.prefix) :] if self.strips else self.path
        headers = {name: value for name, value in self.headers.items() if name.lower() != "connection"}
        if not self.keeps_host:
            headers["Host"] = self.upstream
        body = self.rfile.read(int(self.headers.get("Content-Length", "0")))
        connection = http.client.HTTPConnection(self.upstream, timeout=60)
        connection.request(self.command, path, body or None, headers)
        answer = connection.getresponse()
        self.send_response_only(answer.status)
        for name, value in answer.getheaders():
            if name.lower() not in ("connection", "transfer-encoding"):
                self.send_header(name, value)
        self.send_header("Connection", "close")
        self.end_headers()
        while piece := answer.read1(65_536):
            self.wfile.write(piece)
            self.wfile.flush()
        connection.close()
        self.close_connection = True

    do_GET = do_POST = do_DELETE = do_HEAD = do_PATCH = forward  # noqa: N815

    def log_message(self, *_: Any) -> None:
        """Nothing."""


@contextmanager
def proxy_of(port: int, **settings: Any) -> Iterator[ThreadingHTTPServer]:
    """A proxy that listens on `port`; settings: attributes of `Proxy`."""
    handler = type("OwnProxy", (Proxy,), settings)
    with ThreadingHTTPServer(("127.0.0.1", port), handler) as server:
        server.daemon_threads = True
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        try:
            yield server
        finally:
            server.shutdown()
            thread.join()


def upstream_of(url: str) -> str:
    """Host and port of a service."""
    return urlsplit(url).netloc
