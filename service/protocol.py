"""HTTP/1.1 as uvicorn speaks it, with the one shape of errors also for what is no HTTP at all."""

from __future__ import annotations

import h11
from uvicorn.protocols.http.h11_impl import H11Protocol

from service.problems import problem_response


class Protocol(H11Protocol):
    """Refuses bytes that are no request with a problem of status 400, and closes."""

    def send_400_response(self, msg: str) -> None:
        if self.conn.our_state in (h11.IDLE, h11.SEND_RESPONSE):  # else an answer is under way
            answer = problem_response(400, "this is not a valid HTTP request", headers={"Connection": "close"})
            begin = h11.Response(status_code=400, headers=answer.raw_headers, reason=b"Bad Request")
            for event in (begin, h11.Data(data=bytes(answer.body)), h11.EndOfMessage()):
                self.transport.write(self.conn.send(event) or b"")
        self.transport.close()
