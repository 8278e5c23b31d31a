"""The insertions of an experiment that is over, as a command names them: a folder, or the id of a campaign."""

from __future__ import annotations

import shutil
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from service.cli.connection import service_client, with_field_errors

if TYPE_CHECKING:
    from collections.abc import Iterator

    from service.client.campaign_insertions import CampaignInsertions
    from service.client.client import Client
    from service.local.insertion_sets import InsertionSet


@contextmanager
def insertions_of(
    source: str, scratch: Path, *, data: Path | None, url: str | None, name: str | None = None
) -> Iterator[InsertionSet]:
    """The insertions of a folder, or those of a campaign: of the service at `url`, or in the data folder. scratch:
    folder of what is downloaded, removed at the end. name: of the suite.

    Raises ScenarioError for a folder without insertions and for a campaign that is running, ServiceError for an unknown
    one.
    """
    from service.local.insertion_sets import insertions_in

    if Path(source).is_dir():
        yield insertions_in(Path(source), name=name)
        return
    with _campaign(source, scratch, data=data, url=url) as found:
        found.suite = name or found.suite
        yield found


@contextmanager
def _campaign(campaign_id: str, scratch: Path, *, data: Path | None, url: str | None) -> Iterator[CampaignInsertions]:
    from service.client.campaign_insertions import download_campaign

    try:
        with _client(url, data) as client:
            yield download_campaign(client, campaign_id, scratch)
    finally:
        shutil.rmtree(scratch, ignore_errors=True)


@contextmanager
def _client(url: str | None, data: Path | None) -> Iterator[Client]:
    """A client of the service at `url`, of that on the data folder, which is started if none is running, or of the one
    that was started last."""
    if data is None:
        with service_client(url) as client:
            yield client
        return
    from service.client.client import Client
    from service.server.local_service import running_service
    from service.settings import DEFAULT_HOST, Settings

    settings = Settings.load(data=data, host=DEFAULT_HOST, port=0)
    with running_service(settings) as (address, _), Client(address, settings.api_key) as client, with_field_errors():
        yield client
