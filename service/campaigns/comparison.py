"""Comparing two campaigns, or two controllers of one: paired tests over the paths that both have."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from benchmarks.cases import Outcome
from benchmarks.paper.analysis import at_floor
from benchmarks.paper.comparison import Comparison, compare
from benchmarks.paper.table import Row, arms, by_group, main_rows, only, rows
from service.campaigns.results import outcomes
from service.store.campaign import UnknownCampaignError
from service.store.campaigns import CampaignStore
from simcore.errors import Problem, ScenarioError


@dataclass(frozen=True, kw_only=True)
class CampaignComparison:
    """The tests, one for each group; differences are first minus second. Shared cases: of two campaigns only."""

    campaigns: list[str]
    controllers: list[str] | None
    same_digests: int | None
    shared_cases: int | None
    tests: list[Comparison]


def compare_campaigns(campaigns: CampaignStore, first: str, second: str) -> CampaignComparison:
    """Each controller that both have, in two campaigns by their ids. Raises UnknownCampaignError."""
    results = [outcomes(campaigns.cases(name)) for name in (first, second)]
    digests = [{one.case.id: one.result.get("digest") for one in ended} for ended in results]
    return CampaignComparison(
        campaigns=[first, second],
        controllers=None,
        same_digests=sum(1 for case, digest in digests[0].items() if digest and digests[1].get(case) == digest),
        shared_cases=len(digests[0].keys() & digests[1].keys()),
        tests=between_campaigns(*results),
    )


def compare_controllers(campaigns: CampaignStore, campaign: str, first: str, second: str) -> CampaignComparison:
    """Two controllers of one campaign. Raises UnknownCampaignError, ScenarioError for an unknown controller."""
    tests = between_controllers(outcomes(campaigns.cases(campaign)), first, second)
    return CampaignComparison(
        campaigns=[campaign], controllers=[first, second], same_digests=None, shared_cases=None, tests=tests
    )


def controllers_of(campaigns: CampaignStore, campaign_id: str) -> list[str]:
    """The controllers of a campaign by name; none of an unknown one."""
    try:
        return arms(main_rows(rows(outcomes(campaigns.cases(campaign_id)))))
    except UnknownCampaignError:
        return []


def between_campaigns(first: Sequence[Outcome], second: Sequence[Outcome]) -> list[Comparison]:
    """The same controller in two campaigns, group by group; positive differences: the first is worse."""
    one, other = rows(first), rows(second)
    names = [arm for arm in arms(one) if arm in arms(other)]
    return [
        test for arm in names for test in _tests((f"{arm} (A)", f"{arm} (B)"), only(one, arm=arm), only(other, arm=arm))
    ]


def between_controllers(results: Sequence[Outcome], first: str, second: str) -> list[Comparison]:
    """Two controllers in one campaign, group by group. Raises ScenarioError for a controller that is not in it."""
    table = main_rows(rows(results))
    known = arms(table)
    for field, name in (("first", first), ("second", second)):
        if name not in known:
            raise ScenarioError([Problem(field, name, f"is not in the campaign: {', '.join(known) or 'none'}")])
    return _tests((first, second), only(table, arm=first), only(table, arm=second))


def _tests(names: tuple[str, str], first: Sequence[Row], second: Sequence[Row]) -> list[Comparison]:
    """One test for each group that both have and that can be tested."""
    mine, theirs = by_group(first), by_group(second)
    tests = [
        compare(mine[group], theirs[group], group=group, names=names, floor=at_floor([*mine[group], *theirs[group]]))
        for group in mine
        if group in theirs
    ]
    return [test for test in tests if test is not None]
