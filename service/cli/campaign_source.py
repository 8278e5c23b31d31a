"""The insertions of a campaign, from the service that has them."""

from __future__ import annotations

import shutil
from contextlib import contextmanager
from typing import TYPE_CHECKING

from service.cli.connection import service_client, with_field_errors

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from service.client.campaign_insertions import CampaignInsertions
    from service.client.client import Client


@contextmanager
def campaign_insertions(
    campaign_id: str, *, url: str | None, data: Path | None, scratch: Path
) -> Iterator[CampaignInsertions]:
    """The insertions of a campaign that has ended. scratch: folder of what is downloaded, removed at the end.

    Raises ScenarioError for one that is running, ServiceError for an unknown one.
    """
    from service.client.campaign_insertions import download_campaign

    try:
        with client_of(url, data) as client:
            yield download_campaign(client, campaign_id, scratch)
    finally:
        shutil.rmtree(scratch, ignore_errors=True)


@contextmanager
def client_of(url: str | None, data: Path | None) -> Iterator[Client]:
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
