"""A connection to one service: requests, downloads, and what a refusal means."""

from __future__ import annotations

from pathlib import Path
from types import TracebackType
from typing import Any, Self
from urllib.parse import urlsplit

import httpx2

from service.settings import is_loopback
from simcore.errors import NeedlebenchError, Problem


class ServiceError(NeedlebenchError):
    """The service refused; `status` is the HTTP status, `problems` names each wrong field, its value and the range."""

    def __init__(self, status: int, detail: str, problems: list[Problem]) -> None:
        self.status, self.detail, self.problems = status, detail, problems
        super().__init__("\n".join(str(problem) for problem in problems) or detail)


class Unreachable(NeedlebenchError):
    """Nobody answers at the address."""


class Connection:
    """What every part of the client speaks through. Use it as a context manager, or close it."""

    def __init__(self, url: str, api_key: str | None = None, *, timeout_s: float = 30.0) -> None:
        headers = {"Authorization": f"Bearer {api_key}"} if api_key else {}
        local = is_loopback(urlsplit(url).hostname or "")
        self.url = url.rstrip("/")
        self._http = httpx2.Client(
            base_url=self.url,
            headers=headers,
            timeout=httpx2.Timeout(timeout_s, connect=10.0),
            trust_env=not local,  # a proxy cannot reach this machine's loopback
        )

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Give the connections back."""
        self._http.close()

    def _json(self, method: str, path: str, **options: Any) -> Any:
        return self._request(method, path, **options).json()

    def _request(self, method: str, path: str, **options: Any) -> httpx2.Response:
        try:
            answer = self._http.request(method, path, **options)
        except httpx2.TransportError as error:
            raise Unreachable(
                f"no needlebench service answers at {self.url} ({error}): start one with needlebench serve"
            ) from None
        if answer.is_error:
            raise refusal(answer)
        return answer

    def _download(self, path: str, target: Path) -> Path:
        draft = target.with_name(f".{target.name}.part")
        try:
            with self._http.stream("GET", path) as answer:
                if answer.is_error:
                    answer.read()
                    raise refusal(answer)
                with draft.open("wb") as file:
                    for chunk in answer.iter_bytes():
                        file.write(chunk)
            draft.replace(target)
        except httpx2.TransportError as error:
            raise Unreachable(f"the download from {self.url} broke off: {error}") from None
        finally:
            draft.unlink(missing_ok=True)
        return target


def refusal(answer: httpx2.Response) -> ServiceError:
    """The error that the service answered with."""
    try:
        problem = answer.json()
        found = [Problem(e["field"], e["value"], e["message"]) for e in problem.get("errors") or []]
        return ServiceError(answer.status_code, str(problem["detail"]), found)
    except (ValueError, KeyError, TypeError):
        return ServiceError(answer.status_code, f"{answer.status_code}: not a needlebench service?", [])
