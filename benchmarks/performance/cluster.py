"""What a task costs on a cluster besides its own work: 10,000 tasks of 5 ms through all that an insertion goes through.

Scheduler, workers and campaign are processes of this machine, so wall time is that of too many processes for its cores;
CPU time is what each part needs for a task anywhere. With it the largest cluster follows that one scheduler can feed.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from benchmarks.measurements import Part, Table, figure

if TYPE_CHECKING:
    from benchmarks.ports import BenchPorts

TASKS, QUICK_TASKS = 10_000, 100
WORKERS = 4
INSERTIONS_S = (5.0, 10.0, 30.0)  # of an insertion, for the table


def cluster(ports: BenchPorts) -> Part:
    """CPU time of scheduler, campaign and worker for a task, and how many workers one scheduler can feed."""
    tasks = QUICK_TASKS if ports.quick else TASKS
    ports.say(f"cluster: {tasks} tasks of 5 ms on {WORKERS} workers")
    cost = ports.cluster(tasks, WORKERS)
    each = {
        "scheduler_cpu": cost.scheduler_cpu_s,
        "campaign_cpu": cost.campaign_cpu_s,
        "worker_cpu": cost.workers_cpu_s,
        "wall": cost.wall_s,
    }
    figures = [figure(f"cluster.{name}_ms_a_task", "ms", [1e3 * value / cost.tasks]) for name, value in each.items()]
    busiest_s = max(cost.scheduler_cpu_s, cost.campaign_cpu_s) / cost.tasks
    rows = tuple((f"{seconds:g} s", int(seconds / busiest_s)) for seconds in INSERTIONS_S)
    limits = Table(
        f"workers that one scheduler and one campaign can feed ({1e3 * busiest_s:.2f} ms of CPU a task)",
        ("an insertion takes", "workers at most"),
        rows,
    )
    return Part(tuple(figures), (limits,))
