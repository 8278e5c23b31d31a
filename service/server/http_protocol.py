"""HTTP/1.1 as uvicorn speaks it, with the one shape of errors also for what is no HTTP at all."""

from __future__ import annotations

from uvicorn.protocols.http.httptools_impl import STATUS_LINE, HttpToolsProtocol

from service.api.problems import problem_response

MAXIMUM_OVERHEAD_BYTES = 65_536  # of a request: what it is beside its body; the parser itself would take any amount


class Protocol(HttpToolsProtocol):
    """Refuses bytes that are no request, and requests that do not come to their body, with a problem; then closes."""

    _left = MAXIMUM_OVERHEAD_BYTES

    def data_received(self, data: bytes) -> None:
        self._left -= len(data)
        super().data_received(data)
        if self._left < 0 and not self.transport.is_closing():
            self._refuse(431, f"the headers are longer than {MAXIMUM_OVERHEAD_BYTES} bytes")

    def on_body(self, body: bytes) -> None:
        self._left += 2 * len(body)  # as much again for the marks between its chunks
        super().on_body(body)

    def on_message_complete(self) -> None:
        self._left = MAXIMUM_OVERHEAD_BYTES
        super().on_message_complete()

    def send_400_response(self, msg: str) -> None:
        self._refuse(400, "this is not a valid HTTP request")

    def _refuse(self, status: int, detail: str) -> None:
        if self.cycle is None or self.cycle.response_complete or not self.cycle.response_started:
            answer = problem_response(status, detail, headers={"Connection": "close"})
            fields = (name + b": " + value + b"\r\n" for name, value in answer.raw_headers)
            self.transport.write(b"".join((STATUS_LINE[status], *fields, b"\r\n", bytes(answer.body))))
        self.transport.close()
