"""What a job will cost, before it runs: steps, nodes, time, memory. Accurate to about a factor of two.

A step solves with the banded factor of the tissue, so its time grows with unknowns x band; the constants [ours] are
fitted to process CPU times of full insertions at element sizes of 10 to 3 mm on a 2.6 GHz server core. Memory is
counted: most of it is the factor, 4 bytes x unknowns x band, kept as matrix, as factor and as the previous factor.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from simcore.errors import Problem, ScenarioError
from simcore.scenario.controller_blocks import InverseFem, Remote, SeparateModel

if TYPE_CHECKING:
    from service.settings import Limits
    from simcore.scenario.blocks import Tissue
    from simcore.scenario.scenario import Scenario

BASE_MB = 400.0  # Python with every library of a job, Rerun too
STEP_MS, MS_PER_NODE, MS_PER_ENTRY = 1.0, 1.0e-3, 3.0e-6  # entry: one of the factor's band
EXACT_STEPS, PERTURBATION_STEPS = 12.0, 11.0  # a Jacobian of this kind takes as long as so many steps
FACTORS = 3  # the matrix, its factor, and the previous factor while the next is computed
BYTES_PER_NODE = 5000  # of arrays by node and by tetrahedron
BYTES_PER_STEP = 1500
LEAST_LIMIT_S, MOST_LIMIT_S = 3600.0, 86400.0  # default limits of an attempt
PATIENCE = 4.0  # estimates that a job may take: they are rough, and machines differ
FRAME_BYTES_PER_NODE = 48  # positions in a recorded frame, twice: the series is assembled from them


@dataclass(frozen=True, kw_only=True)
class Cost:
    """An estimate. nodes: of the finest mesh of the scenario."""

    steps: int
    nodes: int
    step_ms: float
    memory_mb: float

    @property
    def time_s(self) -> float:
        """CPU time of the run."""
        return self.steps * self.step_ms * 1e-3

    def __str__(self) -> str:
        return (
            f"estimate: {self.nodes} nodes, {self.steps} steps of {self.step_ms:.3g} ms, "
            f"{self.time_s / 3600:.3g} h, {self.memory_mb:.0f} MB"
        )


def time_limit_s(requested: float | None, *costs: Cost) -> float:
    """Most wall time of an attempt: as requested; else an hour, or four times the longest estimate, up to a day."""
    if requested is not None:
        return requested
    longest = max(cost.time_s for cost in costs)
    return min(MOST_LIMIT_S, max(LEAST_LIMIT_S, PATIENCE * longest))


@dataclass(frozen=True)
class _Size:
    """Of one finite element model. unknowns: free degrees of freedom; band: half-bandwidth in them."""

    nodes: int
    unknowns: int
    band: int

    @property
    def step_ms(self) -> float:
        return STEP_MS + MS_PER_NODE * self.nodes + MS_PER_ENTRY * self.unknowns * self.band

    @property
    def bytes(self) -> float:
        return FACTORS * 4 * self.unknowns * (self.band + 1) + BYTES_PER_NODE * self.nodes


def cost_of(scenario: Scenario) -> Cost:
    """The estimate of a valid scenario. Files are looked up as `simcore.file_names` says at that moment."""
    plant = _size_of(scenario.tissue)
    sizes, step_ms = [plant], plant.step_ms
    controller = scenario.controller
    if isinstance(controller, InverseFem):
        model = plant
        if isinstance(controller.model, SeparateModel):
            changed = {"element_size_mm": controller.model.element_size_mm}
            model = _size_of(scenario.tissue.model_copy(update=changed))
            sizes.append(model)
            step_ms += model.step_ms
        if controller.jacobian == "perturbation":
            step_ms += PERTURBATION_STEPS * model.step_ms
        elif controller.derivative == "exact":
            step_ms += EXACT_STEPS * model.step_ms
    frames = scenario.steps / scenario.recording.every_steps if scenario.recording.enabled else 1
    recorded = FRAME_BYTES_PER_NODE * plant.nodes * frames + BYTES_PER_STEP * scenario.steps
    memory_mb = BASE_MB + 1e-6 * (sum(size.bytes for size in sizes) + recorded)
    nodes = max(size.nodes for size in sizes)
    return Cost(steps=scenario.steps, nodes=nodes, step_ms=step_ms, memory_mb=memory_mb)


def check_cost(scenario: Scenario, limits: Limits) -> Cost:
    """The estimate. Raises ScenarioError, with it in the message, for a scenario beyond the limits, and for one that is
    steered from outside of the service."""
    if isinstance(scenario.controller, Remote):
        where = "is steered by another program, which no service starts or lets in: use `needlebench run`, or Python"
        raise ScenarioError([Problem("controller.kind", "remote", where)])
    cost = cost_of(scenario)
    mesh = "tissue.mesh_file" if scenario.tissue.mesh_file is not None else "tissue.element_size_mm"
    size = scenario.tissue.mesh_file or scenario.tissue.element_size_mm
    problems = [
        Problem(field, value, f"{effect}, at most {most} are allowed here ({cost})")
        for field, value, effect, over, most in (
            (mesh, size, f"gives {cost.nodes} nodes", cost.nodes > limits.nodes, limits.nodes),
            ("dt_s", scenario.dt_s, f"gives {cost.steps} steps", cost.steps > limits.steps, limits.steps),
            (
                "dt_s",
                scenario.dt_s,
                f"makes the job take about {cost.time_s / 3600:.3g} hours",
                cost.time_s > 3600 * limits.job_hours,
                limits.job_hours,
            ),
            (
                mesh,
                size,
                f"makes the job need about {cost.memory_mb:.0f} MB",
                cost.memory_mb > limits.job_memory_mb,
                limits.job_memory_mb,
            ),
        )
        if over
    ]
    if problems:
        raise ScenarioError(problems)
    return cost


def _size_of(tissue: Tissue) -> _Size:
    return _box_size(tissue) if tissue.mesh_file is None else _file_size(tissue, tissue.mesh_file)


def _box_size(tissue: Tissue) -> _Size:
    """As `simcore.mesh.mesh.BoxMesh` numbers its nodes: plane by plane along the longest axis."""
    held = [sum(f"{axis}_{end}" in tissue.held_faces for end in ("min", "max")) for axis in "xyz"]
    order = sorted(range(3), key=lambda axis: tissue.cells[axis])
    short, middle, long = (max(1, tissue.cells[axis] + 1 - held[axis]) for axis in order)
    nodes = math.prod(count + 1 for count in tissue.cells)
    return _Size(nodes, 3 * short * middle * long, 3 * (short * middle + short + 1) + 2)


def _file_size(tissue: Tissue, name: str) -> _Size:
    from simcore.mesh.numbering import free_node_order, half_bandwidth
    from simcore.mesh.reader import load_mesh  # with the mesh kernels: only where there is a mesh file
    from simcore.scenario.held_parts import held_of

    mesh = load_mesh(name, unit_mm=tissue.mesh_unit_mm, names=tissue.fixed_sets, sha256=tissue.mesh_sha256)
    unknown = free_node_order(mesh, held_of(tissue, mesh))
    free = int(np.count_nonzero(unknown >= 0))
    return _Size(len(mesh.nodes_m), 3 * free, half_bandwidth(mesh.tets, unknown))
