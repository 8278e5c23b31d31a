"""Comparing two campaigns, or the arms of one: paired tests over the cases that differ in nothing else."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from benchmarks.grid.design import between_arms
from benchmarks.grid.report import arm_comparisons, compare_arms
from benchmarks.paper.analysis import at_floor
from benchmarks.paper.comparison import Comparison, compare, corrected
from benchmarks.paper.table import Row, arms, by_group, main_rows, only, rows
from service.campaigns.results import outcomes
from service.store.campaign import UnknownCampaignError
from simcore.errors import Problem, ScenarioError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from benchmarks.cases import Outcome
    from service.store.campaigns import CampaignStore


@dataclass(frozen=True, kw_only=True)
class CampaignComparison:
    """The tests, one for each group and couple; differences are first minus second. arms: None of two campaigns.
    Shared cases: of two campaigns only."""

    campaigns: list[str]
    arms: list[str] | None
    same_digests: int | None
    shared_cases: int | None
    tests: list[Comparison]


def compare_campaigns(campaigns: CampaignStore, first: str, second: str) -> CampaignComparison:
    """Each arm that both have by name, in two campaigns by their ids. Raises UnknownCampaignError."""
    results = [outcomes(campaigns.cases(name)) for name in (first, second)]
    digests = [{one.case.id: one.result.get("digest") for one in ended} for ended in results]
    return CampaignComparison(
        campaigns=[first, second],
        arms=None,
        same_digests=sum(1 for case, digest in digests[0].items() if digest and digests[1].get(case) == digest),
        shared_cases=len(digests[0].keys() & digests[1].keys()),
        tests=between_campaigns(*results),
    )


def compare_within(campaigns: CampaignStore, campaign: str, names: Sequence[str] = ()) -> CampaignComparison:
    """Two arms of one campaign, or all of them without names. Raises UnknownCampaignError, ScenarioError for an unknown
    arm or a campaign of a single one."""
    table = main_rows(rows(outcomes(campaigns.cases(campaign))))
    known = arms(table)
    unknown = [name for name in names if name not in known]
    if unknown:
        raise ScenarioError([Problem("arms", unknown[0], f"is not in the campaign: {', '.join(known) or 'none'}")])
    if not names and len(known) < 2:
        raise ScenarioError([Problem("campaigns", [campaign], f"has one arm to compare: {', '.join(known) or 'none'}")])
    tests = between_arms_of(table, *names) if names else arm_comparisons(table)
    return CampaignComparison(
        campaigns=[campaign], arms=list(names or known), same_digests=None, shared_cases=None, tests=tests
    )


def arms_of(campaigns: CampaignStore, campaign_id: str) -> list[str]:
    """The arms of a campaign by name; none of an unknown one."""
    try:
        return arms(main_rows(rows(outcomes(campaigns.cases(campaign_id, whole=False)))))
    except UnknownCampaignError:
        return []


def between_campaigns(first: Sequence[Outcome], second: Sequence[Outcome]) -> list[Comparison]:
    """The same arm in two campaigns, group by group; positive differences: the first is worse."""
    one, other = main_rows(rows(first)), main_rows(rows(second))
    names = [arm for arm in arms(one) if arm in arms(other)]
    return corrected([test for arm in names for test in _of_arm(arm, only(one, arm=arm), only(other, arm=arm))])


def between_arms_of(table: Sequence[Row], first: str, second: str) -> list[Comparison]:
    """Two arms of one campaign, group by group."""
    tests = [compare_arms(members, first, second, group=group) for group, members in by_group(table).items()]
    return corrected([test for test in tests if test is not None])


def _of_arm(arm: str, first: Sequence[Row], second: Sequence[Row]) -> list[Comparison]:
    """One test for each group that both have and that can be tested."""
    mine, theirs, tests = by_group(first), by_group(second), []
    for group in (name for name in mine if name in theirs):
        one, other = mine[group], theirs[group]
        test = compare(
            one,
            other,
            group=group,
            names=(f"{arm} (A)", f"{arm} (B)"),
            floor=at_floor([*one, *other]),
            design=between_arms(one, other),
        )
        tests += [] if test is None else [replace(test, notes=(*test.notes, *_other_code(arm, one, other)))]
    return tests


def _other_code(arm: str, first: Sequence[Row], second: Sequence[Row]) -> list[str]:
    """What ran under one name in two campaigns, if that is not the same."""
    found = [{row.steered_by.id: row.steered_by for row in side if row.steered_by} for side in (first, second)]
    if not all(found) or found[0].keys() == found[1].keys():
        return []
    editions = [", ".join(sorted({one.edition for one in side.values()} - {""})) for side in found]
    if editions[0] == editions[1]:
        return [f"{arm} has other settings or files in A than in B"]
    return [f"{arm} is {editions[0] or 'without a code of its own'} in A and {editions[1] or 'none'} in B"]
