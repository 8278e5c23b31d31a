"""What a monitor reads at /metrics, in the format of Prometheus. Each service has its own registry."""

from __future__ import annotations

import platform
from collections.abc import Callable, Iterator

from prometheus_client import CollectorRegistry, Counter, Histogram, ProcessCollector, generate_latest
from prometheus_client.core import GaugeMetricFamily, InfoMetricFamily, Metric
from prometheus_client.registry import Collector

from service.store.job import Job
from service.version import installed_version
from simcore.provenance import commit

_JOB_S = (1, 2, 5, 10, 20, 60, 120, 300, 600, 1800, 3600, 7200, 21600)
_ANSWER_S = (0.001, 0.0025, 0.005, 0.01, 0.025, 0.05, 0.1, 0.25, 0.5, 1, 2.5, 5, 10, 30, 60)

Reading = tuple[str, str, dict[str, float]]  # name, what it is, value by label; the label "" for a single value


class Monitor:
    """Counts what happens; what is so at the moment is asked of `add`'s questions whenever somebody reads."""

    def __init__(self) -> None:
        self._registry = CollectorRegistry()
        registry = self._registry
        ProcessCollector(registry=registry)
        self._duration = Histogram(
            "needlebench_job_duration_seconds",
            "Wall time of attempts that ended, by the state that they led to.",
            ["state"],
            buckets=_JOB_S,
            registry=registry,
        )
        self._wait = Histogram(
            "needlebench_job_wait_seconds",
            "Time from submission to the first start.",
            buckets=_JOB_S,
            registry=registry,
        )
        self._restarts = Counter(
            "needlebench_worker_restarts", "Worker processes started in place of another.", registry=registry
        )
        self._answers = Histogram(
            "needlebench_http_answer_seconds",
            "Time to the beginning of an answer, long polls included.",
            ["method", "route", "status"],
            buckets=_ANSWER_S,
            registry=registry,
        )

    def add(self, questions: Callable[[], Iterator[Reading]]) -> None:
        """Ask these too."""
        self._registry.register(_Now(questions))

    def started(self, job: Job) -> None:
        """An attempt began."""
        if job.attempt == 1 and job.started_at is not None:
            self._wait.observe(max(0.0, job.started_at - job.created_at))

    def ended(self, state: str, duration_s: float) -> None:
        """An attempt led to this state."""
        self._duration.labels(state).observe(duration_s)

    def restarted(self) -> None:
        """A worker process was replaced."""
        self._restarts.inc()

    def answered(self, method: str, route: str, status: int, duration_s: float) -> None:
        """A request was answered."""
        self._answers.labels(method, route, status).observe(duration_s)

    def text(self) -> bytes:
        """Everything, in the text format of Prometheus."""
        return generate_latest(self._registry)


class _Now(Collector):
    """What is so at the moment; asked at each reading."""

    def __init__(self, questions: Callable[[], Iterator[Reading]]) -> None:
        self._questions = questions

    def describe(self) -> Iterator[Metric]:
        """Nothing: asking is left to the first reading."""
        return iter(())

    def collect(self) -> Iterator[Metric]:
        """What is so now, and the build."""
        for name, text, values in self._questions():
            if "" in values:
                yield GaugeMetricFamily(name, text, value=values[""])
                continue
            family = GaugeMetricFamily(name, text, labels=["state"])
            for label, value in values.items():
                family.add_metric([label], value)
            yield family
        about = {"version": installed_version(), "commit": commit() or "", "python": platform.python_version()}
        yield InfoMetricFamily("needlebench_build", "What runs.", value=about)
