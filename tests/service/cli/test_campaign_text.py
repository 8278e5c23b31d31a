from __future__ import annotations

import pytest

from service.cli.campaign_text import where
from service.client.campaigns import CampaignStatus


@pytest.mark.parametrize(
    ("state", "jobs", "told"),
    [
        ("running", {"finished": 1, "queued": 2}, "1 of 3 insertions, 60 s left"),
        ("done", {"finished": 2, "failed": 1}, "3 of 3 insertions, 1 failed"),
        ("done", {"finished": 1}, "3 of 3 insertions, the jobs of 2 since removed"),
        ("done", {}, "3 of 3 insertions, the jobs of 3 since removed"),
    ],
)
def test_where_a_campaign_is_counts_the_jobs_that_were_cleared_away(
    state: str, jobs: dict[str, int], told: str
) -> None:
    now = CampaignStatus(
        id="a", name="n", suite="s", state=state, cases=3, jobs=jobs, fraction=0.5, eta_s=60.0, created_at="", raw={}
    )
    assert where(now) == told
