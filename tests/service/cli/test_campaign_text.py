from __future__ import annotations

import pytest

from benchmarks.paper.table import BESIDE as OF_TABLES
from service.cli.campaign_text import BESIDE, beside_text, where
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


def test_a_terminal_has_the_columns_of_every_table() -> None:
    assert list(BESIDE) == list(OF_TABLES)
    assert [digits for _, digits in BESIDE.values()] == [digits for _, digits in OF_TABLES.values()]
    shown = beside_text({"rcm_max_mm": 1.234, "max_push_n": None, "max_needle_stress_mpa": 812.4})
    assert shown.split() == ["1.23", "-", "-", "-", "-", "812"]
