"""Libraries whose insides are overridden are of the versions that the overrides were written for."""

from __future__ import annotations

from importlib.metadata import version
from types import ModuleType

import pebble
import pytest
import uvicorn
from uvicorn.protocols.http.httptools_impl import HttpToolsProtocol

from service.server import uvicorn_overrides
from service.worker import pebble_overrides

OVERRIDES = (uvicorn_overrides, pebble_overrides)


def numbers(text: str) -> list[int]:
    return [int(part) for part in text.split(".") if part.isdigit()]


def complaint(overrides: ModuleType, installed: str) -> str | None:
    """What to do when the installed version is another than the overrides were written for."""
    package, first, below = overrides.WRITTEN_FOR
    if numbers(first) <= numbers(installed) < numbers(below):
        return None
    return (
        f"{package} {installed} is installed, and {overrides.__name__} was written for {first} or later, below "
        f"{below}: read what changed in what it overrides, then move WRITTEN_FOR and the bounds in pyproject.toml"
    )


@pytest.mark.parametrize("overrides", OVERRIDES, ids=lambda module: module.WRITTEN_FOR[0])
def test_the_installed_version_is_one_that_the_overrides_were_written_for(overrides: ModuleType) -> None:
    message = complaint(overrides, version(overrides.WRITTEN_FOR[0]))
    assert message is None, message


def test_another_version_is_named_with_its_bounds() -> None:
    assert complaint(uvicorn_overrides, "0.54.3") is None
    assert "uvicorn 0.55.0 is installed" in (complaint(uvicorn_overrides, "0.55.0") or "")
    assert "0.54 or later, below 0.55" in (complaint(uvicorn_overrides, "0.9") or "")


def test_what_is_overridden_is_there() -> None:
    for name in ("data_received", "on_body", "on_message_complete", "send_400_response"):
        assert callable(getattr(HttpToolsProtocol, name))
        assert name in vars(uvicorn_overrides.Protocol)
    for name in ("on_tick", "handle_exit", "startup", "shutdown"):
        assert callable(getattr(uvicorn.Server, name))
        assert name in vars(uvicorn_overrides.Server)
    assert pebble.CONSTS.term_timeout >= 0
    assert isinstance(pebble.ProcessPool.active, property)


def test_a_worker_that_is_told_to_end_gets_its_fifth_of_a_second() -> None:
    pool = pebble_overrides.single_worker_pool(print)
    assert pebble.CONSTS.term_timeout == pebble_overrides.TERM_TIMEOUT_S == 0.2
    pool.stop()  # type: ignore[no-untyped-call]
    pool.join()
