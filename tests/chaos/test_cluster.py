"""A campaign on a cluster whose workers and scheduler are killed: nothing lost, nothing twice, verified elsewhere."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING

import pytest

from tests.chaos.cluster_campaign import same_as_here, under_kills, verified_elsewhere
from tests.chaos.conftest import JOBS

if TYPE_CHECKING:
    import random
    from pathlib import Path

DIGESTS = 4


def test_a_campaign_on_a_cluster_under_kills(
    tmp_path: Path, moments: int, chance: random.Random, figures: dict[str, object]
) -> None:
    if JOBS not in os.environ:
        pytest.skip("a measurement of minutes: make chaos; tests/service/cluster has a short form")
    insertions = int(os.environ[JOBS])
    figures.update(under_kills(tmp_path, insertions, moments, chance))
    assert same_as_here(tmp_path, insertions, DIGESTS) == DIGESTS
    verdict = verified_elsewhere(tmp_path, DIGESTS)
    assert f"{DIGESTS} identical" in verdict
    figures.update(verified_elsewhere=f"{DIGESTS} identical")
