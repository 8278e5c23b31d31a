"""What a campaign has measured is read once, and again after every change of one of its jobs."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from service.campaigns.measured import Measured, MeasuredCampaigns
from service.store.campaign import UnknownCampaignError
from service.store.job import FAILED, Outcome
from tests.service.campaigns.test_campaigns import ended, start
from tests.service.http import idle_service

if TYPE_CHECKING:
    from pathlib import Path


def test_it_is_read_again_after_every_change_and_not_before(tmp_path: Path) -> None:
    with idle_service(tmp_path) as (http, service):
        campaign = start(http)["id"]

        def looked_at() -> Measured:
            found = service.measured.of(campaign)
            assert service.measured.of(campaign) is found
            assert found == Measured.of(service.campaigns.cases(campaign))
            return found

        assert looked_at().ended == 0
        job = service.store.claim()
        assert job is not None
        assert [one.state for one in looked_at().results] == ["running", *["queued"] * 3]
        service.store.finish(job, Outcome(state=FAILED, error_kind="exception", error="it broke"))
        found = looked_at()
        assert (found.ended, found.results[0].message, found.arms) == (1, "it broke", ["ifem"])
        service.store.delete(job.id)
        assert looked_at().results[0].job_id is None
        with pytest.raises(UnknownCampaignError):
            service.measured.of("0" * 16)


def test_no_more_cases_are_kept_than_there_is_room_for(tmp_path: Path) -> None:
    with idle_service(tmp_path) as (http, service):
        first, second = (ended((http, service))["id"] for _ in range(2))
        narrow, none = (MeasuredCampaigns(service.campaigns, most=most) for most in (4, 3))
        kept = narrow.of(first)
        assert narrow.of(first) is kept
        narrow.of(second)
        assert narrow.of(first) is not kept
        assert none.of(first) is not none.of(first)
