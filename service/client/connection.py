"""A connection to one service: requests, downloads, and what a refusal means."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING, Any, BinaryIO, Self
from urllib.parse import quote, urlsplit

import httpx2

from service.files.endpoint import endpoint, local_token
from service.settings import data_dir
from simcore.errors import NeedlebenchError, Problem, ScenarioError
from simcore.remote.link import is_loopback

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path
    from types import TracebackType

_PAGE = 1000  # items of a list that are fetched at once
CONNECT_S = 10.0
TRIES = 4  # of a request that may be repeated, when no answer comes in time
LONGER = 10  # times as long is waited for the answer to one that may not


class ServiceError(NeedlebenchError):
    """The service refused; `status` is the HTTP status, `problems` names each wrong field, its value and the range."""

    def __init__(self, status: int, detail: str, problems: list[Problem]) -> None:
        self.status, self.detail, self.problems = status, detail, problems
        super().__init__("\n".join(str(problem) for problem in problems) or detail)


class UnreachableError(NeedlebenchError):
    """No service answers at the address."""


class CannotWriteError(NeedlebenchError):
    """The file of a download cannot be written; says which and why."""


def part(name: str) -> str:
    """An id or a name as one part of an address, whatever its characters; dots cannot lead to another path."""
    return quote(name, safe="") if name.strip(".") else name.replace(".", "%2E") or "%20"


class Connection:
    """An HTTP connection to one service. Use it as a context manager, or close it."""

    def __init__(self, url: str, api_key: str | None = None, *, timeout_s: float = 30.0) -> None:
        if api_key and not (api_key.isascii() and api_key.isprintable()):
            raise ScenarioError([Problem("API key", "(hidden)", "must be printable ASCII characters")])
        self.url, self.timeout_s = url.rstrip("/"), timeout_s
        try:
            local = is_loopback(urlsplit(url).hostname or "")
            known = api_key or (_token_of(self.url) if local else None)
            headers = {"Authorization": f"Bearer {known}"} if known else {}
            self._http = httpx2.Client(
                base_url=self.url,
                headers=headers,
                timeout=httpx2.Timeout(timeout_s, connect=CONNECT_S),
                trust_env=not local,  # a proxy cannot reach this machine's loopback
            )
        except (ValueError, httpx2.InvalidURL) as error:
            raise UnreachableError(
                f"{url!r} is not the address of a service, as in http://127.0.0.1:8321: {error}"
            ) from None

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Close the connections."""
        self._http.close()

    def _json(self, method: str, path: str, **options: Any) -> Any:
        answer = self._request(method, path, **options)
        try:
            return answer.json()
        except ValueError:
            raise ServiceError(
                answer.status_code, f"what answers at {self.url} is not a needlebench service", []
            ) from None

    def _items(self, path: str) -> Iterator[dict[str, Any]]:
        """The items of a list, page by page to its end."""
        cursor: dict[str, str] = {}
        while True:
            page = self._json("GET", path, params={"limit": _PAGE, **cursor})
            yield from page["items"]
            if page["next_cursor"] is None:
                return
            cursor = {"cursor": page["next_cursor"]}

    def _request(self, method: str, path: str, **options: Any) -> httpx2.Response:
        """Raises ServiceError and UnreachableError. On a machine that has much else to do an answer may take long: what
        changes nothing, or is the same when repeated, is asked again; for all else it is waited longer."""
        repeatable = method in ("GET", "HEAD") or "Idempotency-Key" in (options.get("headers") or {})
        patience_s: float = options.pop("timeout", self.timeout_s * (1 if repeatable else LONGER))
        for left in reversed(range(TRIES if repeatable else 1)):
            try:
                timeout = httpx2.Timeout(patience_s, connect=CONNECT_S)
                answer = self._http.request(method, path, timeout=timeout, **options)
            except httpx2.ReadTimeout:
                if not left:
                    raise UnreachableError(
                        f"the service at {self.url} does not answer, within {patience_s:g} s: is the machine very busy?"
                    ) from None
            except httpx2.TransportError as error:
                raise UnreachableError(
                    f"no needlebench service answers at {self.url} ({error}): start one with needlebench serve"
                ) from None
            else:
                break
        if answer.is_error:
            raise refusal(answer)
        return answer

    def _download(self, path: str, target: Path) -> Path:
        draft = target.with_name(f".{target.name}.part")
        try:
            patience = httpx2.Timeout(LONGER * self.timeout_s, connect=CONNECT_S)
            with self._http.stream("GET", path, timeout=patience) as answer:
                if answer.is_error:
                    answer.read()
                    raise refusal(answer)
                with _writable(draft, target) as file:
                    for chunk in answer.iter_bytes():
                        file.write(chunk)
            draft.replace(target)
        except httpx2.TransportError as error:
            raise UnreachableError(f"the download from {self.url} was interrupted: {error}") from None
        finally:
            draft.unlink(missing_ok=True)
        return target


def _token_of(url: str) -> str | None:
    """Where the system does not say which account asks: what the data folder of this account says to its service."""
    if sys.platform == "linux":
        return None
    data = data_dir()
    return local_token(data) if endpoint(data) == url else None


def _writable(draft: Path, target: Path) -> BinaryIO:
    try:
        return draft.open("wb")
    except OSError as error:
        raise CannotWriteError(f"{target} cannot be written: {error.strerror}") from None


def refusal(answer: httpx2.Response) -> ServiceError:
    """The error behind a response of the service."""
    try:
        problem = answer.json()
        wrong = [Problem(e["field"], e["value"], e["message"]) for e in problem.get("errors") or []]
        return ServiceError(answer.status_code, str(problem["detail"]), wrong)
    except (ValueError, KeyError, TypeError):
        return ServiceError(answer.status_code, f"{answer.status_code}: not a needlebench service?", [])
