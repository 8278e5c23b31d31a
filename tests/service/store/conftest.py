"""A store with a clock that is passed in, and what it told its listeners; a service whose uploads are small."""

from collections.abc import Iterator
from itertools import count
from pathlib import Path

import pytest
from starlette.testclient import TestClient

from service.api.context import Service
from service.settings import Limits
from service.store.database import open_database
from service.store.jobs import Store
from tests.service.databases import lay_down
from tests.service.http import idle_service


@pytest.fixture
def heard() -> list[str]:
    return []


@pytest.fixture
def store(tmp_path: Path, heard: list[str]) -> Iterator[Store]:
    clock = count(1000.5)
    opened = Store(open_database(lay_down(tmp_path / "jobs.sqlite")), now=lambda: next(clock))
    opened.listen(heard.append)
    yield opened
    opened.close()


@pytest.fixture
def both(tmp_path: Path) -> Iterator[tuple[TestClient, Service]]:
    with idle_service(tmp_path / "data", limits=Limits(upload_mb=0.1)) as pair:
        yield pair


@pytest.fixture
def http(both: tuple[TestClient, Service]) -> TestClient:
    return both[0]
