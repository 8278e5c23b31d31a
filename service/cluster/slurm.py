"""The scripts that start a cluster under Slurm: one job for the scheduler, one for the workers."""

from __future__ import annotations

import shlex
import sys
from dataclasses import dataclass
from typing import TYPE_CHECKING

from service.cluster.address import FILE, TLS
from service.cluster.certificates import make_certificates
from service.cluster.identity import identity
from service.cluster.sign_on import write_cluster
from service.files.private import private_folder
from simcore.errors import Problem, ScenarioError

if TYPE_CHECKING:
    from pathlib import Path

SCHEDULER_FILE, LOGS = "scheduler.json", "logs"
SCHEDULER, WORKERS, START = "scheduler.sbatch", "workers.sbatch", "start.sh"
_SCHEDULER_MB = 8000  # [ours]: ten times what it held with 10,000 receipts
_MEANT_OTHERWISE = set("'\"\\%\n")
_MARGIN = 0.1  # of the time, at most ten minutes: the insertions at work end, and nothing new begins


@dataclass(frozen=True, kw_only=True)
class SlurmCluster:
    """folder: on the shared disk. cores: worker processes on each node; None = all of its cores, nobody else on it.
    memory_mb: for each of so many cores. interface: of the
    network, as in ib0, or None. lines: more options of sbatch, as in --partition=long."""

    folder: Path
    nodes: int
    cores: int | None
    time_s: int
    memory_mb: int = 1000
    interface: str | None = None
    lines: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        for line in self.lines:
            if not line.startswith("--") or "\n" in line:
                raise ScenarioError([Problem("--option", line, "must be an option of sbatch, as in --partition=long")])
        if set(str(self.folder)) & _MEANT_OTHERWISE:
            message = (
                "must be a name without quotes, backslashes, percent signs and line ends, which sbatch takes otherwise"
            )
            raise ScenarioError([Problem("--out", str(self.folder), message)])

    def write(self) -> Path:
        """Scripts, certificates and cluster.json into the folder; the script that submits all."""
        private_folder(self.folder)
        (self.folder / LOGS).mkdir(exist_ok=True)
        make_certificates(self.folder / TLS)
        write_cluster(self.folder, identity())
        for name, text in ((SCHEDULER, self._scheduler()), (WORKERS, self._workers()), (START, self._start())):
            path = self.folder / name
            path.write_text(text)
            path.chmod(0o700)
        return self.folder / START

    def _scheduler(self) -> str:
        given = [] if self.interface is None else ["--interface", self.interface]
        command = _command("scheduler", "--out", str(self.folder), "--host", "0.0.0.0", *given)
        return self._script("scheduler", ["--nodes=1", "--ntasks=1", f"--mem={_SCHEDULER_MB}M"], f"exec {command}")

    def _workers(self) -> str:
        lifetime = self.time_s - min(600, round(_MARGIN * self.time_s))
        where = f"{FILE}{self.folder / SCHEDULER_FILE}"
        command = _command("worker", where, "--lifetime", f"{lifetime}s", "--patience", f"{self.time_s}s")
        size = [f"--nodes={self.nodes}", "--cpus-per-task=1", "--hint=nomultithread"]
        if self.cores is None:
            size += ["--exclusive", "--mem=0"]
            each = '--ntasks-per-node="$SLURM_CPUS_ON_NODE"'
            many = f'--ntasks="$((SLURM_CPUS_ON_NODE * SLURM_JOB_NUM_NODES))" {each} --cpus-per-task=1 '
        else:
            size += [f"--ntasks-per-node={self.cores}", f"--mem-per-cpu={self.memory_mb}M"]
            many = ""
        return self._script("workers", size, f"exec srun {many}--kill-on-bad-exit=0 {command}")

    def _script(self, name: str, size: list[str], command: str) -> str:
        """A batch script: its options, then what it runs."""
        minutes = -(-self.time_s // 60)
        log = str(self.folder / LOGS / f"{name}-%j.log")
        options = [
            f"--job-name=needlebench-{name}",
            *size,
            f"--time={minutes}",
            f"--output={shlex.quote(log)}",
            "--requeue",
            *self.lines,
        ]
        head = "\n".join(f"#SBATCH {option}" for option in options)
        return f"#!/bin/sh\n{head}\nset -eu\n{command}\n"

    def _start(self) -> str:
        scheduler, workers = (shlex.quote(str(self.folder / name)) for name in (SCHEDULER, WORKERS))
        return (
            "#!/bin/sh\n"
            "# Submits scheduler and workers. To have more workers: sbatch the second script once more.\n"
            "set -eu\n"
            f"scheduler=$(sbatch --parsable {scheduler})\n"
            f'workers=$(sbatch --parsable --dependency="after:${{scheduler%%;*}}" {workers})\n'
            'echo "scheduler: job ${scheduler%%;*}, workers: job ${workers%%;*}"\n'
        )


def _command(*words: str) -> str:
    return shlex.join([sys.executable, "-m", "service.cli", "cluster", *words])
