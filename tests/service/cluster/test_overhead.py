"""What a task costs: measured on real processes, which are gone afterwards."""

from __future__ import annotations

from typing import TYPE_CHECKING

import psutil
import pytest

from service.cluster.overhead import measure

if TYPE_CHECKING:
    from pathlib import Path

TASKS = 6


@pytest.mark.slow
def test_each_part_is_measured_and_nothing_stays_behind(tmp_path: Path) -> None:
    pytest.importorskip("distributed")
    cost = measure(TASKS, 1, tmp_path)
    assert (cost.tasks, cost.workers) == (TASKS, 1)
    assert cost.wall_s > TASKS * 0.005
    for part_s in (cost.scheduler_cpu_s, cost.campaign_cpu_s, cost.workers_cpu_s):
        assert 0.0 <= part_s < 60.0
    assert cost.campaign_cpu_s > 0.0
    assert not list(tmp_path.rglob("task-*.npz"))
    left = [one for one in psutil.process_iter(["cmdline"]) if str(tmp_path) in " ".join(one.info["cmdline"] or [])]
    assert not left
