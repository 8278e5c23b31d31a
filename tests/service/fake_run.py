"""A run without physics: a needle that slides along the path through a box whose nodes move by a formula.

It emits the records of `simcore.rollout.records` from buffers that it overwrites at every step, so that an observer
that keeps references instead of copies records the wrong numbers.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from simcore.rollout.records import Observer, Scene, StepRecord, StepTiming

if TYPE_CHECKING:
    from simcore.arrays import Floats, Ints
    from simcore.scenario.scenario import Scenario

_CELL_TETS = np.array([[0, a, a + b, 7] for a, b in itertools.permutations((1, 2, 4), 2)])


def box_mesh(scenario: Scenario) -> tuple[Floats, Ints, Ints]:
    """Nodes (n, 3) m, tetrahedra (t, 4) and outward surface triangles (s, 3) of the scenario's block."""
    cells = scenario.tissue.cells
    axes = [np.linspace(0.0, s * 1e-3, c + 1) for s, c in zip(scenario.tissue.size_mm, cells, strict=True)]
    nodes = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    numbers = np.arange(len(nodes)).reshape([c + 1 for c in cells])
    corners = np.stack(
        [
            numbers[i : i + cells[0], j : j + cells[1], k : k + cells[2]].ravel()
            for k, j, i in itertools.product((0, 1), repeat=3)
        ],
        axis=1,
    )
    tets = corners[:, _CELL_TETS].reshape(-1, 4)
    return nodes, tets, _outer_faces(nodes, tets)


def _outer_faces(nodes: Floats, tets: Ints) -> Ints:
    faces = np.concatenate([np.delete(tets, i, axis=1) for i in range(4)])
    _, first, count = np.unique(np.sort(faces, axis=1), axis=0, return_index=True, return_counts=True)
    outer: Ints = faces[first[count == 1]]
    p, q, r = nodes[outer].transpose(1, 0, 2)
    inward = np.einsum("ij,ij->i", np.cross(q - p, r - p), p - nodes.mean(axis=0)) < 0
    outer[inward] = outer[inward][:, ::-1]
    return outer


@dataclass
class FakeRollout:
    """What the recorder and the command line need of a rollout."""

    scenario: Scenario
    status: str = "completed"
    success: bool = True
    warnings: list[str] = field(default_factory=list)
    series: dict[str, Floats] = field(default_factory=dict)

    def result(self) -> dict[str, Any]:
        """In the shape of result.json."""
        return {
            "status": self.status,
            "metrics": {"stable": True, "success": self.success, "rmse_commanded_mm": 0.25, "final_same_time_mm": None},
            "timing": {"plant_ms": {"median": 4.0, "p95": 6.0, "p99": 7.5, "max": 9.0}, "realtime_factor": 1.7},
            "solver": {"iterations_mean": 3.5},
            "digest": "0123456789abcdef" * 4,
            "warnings": [*self.scenario.warnings(), *self.warnings],
            "provenance": {"scenario": self.scenario.resolved(), "seed": self.scenario.seed, "commit": "abc1234"},
        }


class FakeRun:
    """`FakeRun(scenario).run(observer)`; `stop_at` raises `error` after that step."""

    def __init__(self, scenario: Scenario, *, stop_at: int | None = None, error: BaseException | None = None):
        self.scenario = scenario
        self.stop_at, self.error = stop_at, error
        self.nodes, self.tets, self.triangles = box_mesh(scenario)
        self.path = scenario.path()
        self.tissue = self.nodes.copy()
        self.shaft = np.zeros((scenario.needle.elements * 4 + 1, 3))
        self.points = np.zeros((64, 3))
        self.forces = np.zeros((64, 3))
        self.vectors = {name: np.zeros(3) for name in ("base", "tip", "target", "noisy", "force", "torque")}
        self.rotation = np.array([1.0, 0.0, 0.0, 0.0])

    def run(self, observer: Observer) -> FakeRollout:
        """Emit the scene, every record and the rollout."""
        scenario = self.scenario
        radius = scenario.needle.outer_diameter_mm * 0.5e-3
        path = self.path.curve(np.linspace(0, 1, 101))
        scene = Scene(
            scenario, scenario.steps, self.nodes, self.tets, self.triangles, np.array([0, 1]), path, path[0], radius
        )  # fmt: skip
        observer.begin(scene, self.record(0))
        for step in range(1, scenario.steps + 1):
            observer.step(self.record(step))
            if step == self.stop_at and self.error is not None:
                raise self.error
        rollout = FakeRollout(scenario)
        observer.end(rollout)  # type: ignore[arg-type]
        return rollout

    def record(self, step: int) -> StepRecord:
        """The record of one step, on the shared buffers."""
        depth = self.path.length_m * step / self.scenario.steps
        active = self._move(step, depth)
        v = self.vectors
        recording = self.scenario.recording
        shown = recording.enabled and (step % recording.every_steps == 0 or step == self.scenario.steps)
        error = np.linalg.norm(v["tip"] - v["target"])
        return StepRecord(
            step, step * self.scenario.dt_s, v["base"], self.rotation, v["tip"], v["tip"], v["target"], v["noisy"],
            v["base"], self.rotation, step % 7 == 0, depth, v["force"], v["torque"], float(v["force"][2]),
            float(0.3 * error), 3 + step % 4, 10.0 ** (-6 - step % 3), 1e-9, 0.8,
            v["target"], float(np.abs(self.tissue - self.nodes).max()), 0.1, 1e-3, 1e8,
            self.shaft, self.points[:active], self.forces[:active],
            self.tissue if shown else None, StepTiming(4e-3 + 1e-5 * (step % 9), 2e-3, 1e-4),
        )  # fmt: skip

    def _move(self, step: int, depth: float) -> int:
        """Overwrite every buffer with the state of this step; the number of active points."""
        v, across = self.vectors, np.array([0.002, 0.001, 0.0])
        self.shaft[:] = self._axis(depth)
        v["tip"][:], v["base"][:] = self.shaft[-1], self.shaft[0]
        v["target"][:] = self.path.point(np.array([depth]))[0] + 1e-4 * np.sin(step / 20)
        v["noisy"][:] = v["target"] + 1e-5 * (step % 5)
        v["force"][:] = [0.02 * np.sin(step / 30), 0.03, 0.1 + 10.0 * depth]
        v["torque"][:] = 1e-3 * v["force"]
        foot = self.path.curve(self.nodes[:, 2] / self.path.end_m[2])
        near = np.exp(-np.sum((self.nodes - foot) ** 2, axis=1) / 0.012**2)
        reached = 1.0 / (1.0 + np.exp((self.nodes[:, 2] - depth) / 0.004))
        bulge = near * reached * np.sin(np.pi * self.nodes[:, 2] / 0.12)
        self.tissue[:] = self.nodes + bulge[:, None] * across
        active = min(int(depth / 5e-3), 64)
        self.points[:active] = self.path.point(5e-3 * np.arange(active, dtype=np.float64))
        self.forces[:active] = across * 20 * np.sin(np.arange(active) / 3 + step / 100)[:, None]
        return active

    def _axis(self, depth: float) -> Floats:
        """The needle along the path, and straight behind the entry."""
        s: Floats = depth + np.linspace(-self.scenario.needle.length_mm * 1e-3, 0.0, len(self.shaft))
        behind = np.minimum(s, 0.0)[:, None] * self.path.first_tangent()
        inside: Floats = s.clip(min=0.0)
        return self.path.point(inside) + behind
