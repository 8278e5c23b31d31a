"""Steps on their way into a recording: how a step becomes a row, how a block of steps becomes columns.

Positions are in metres. Everything is copied on arrival: the simulation overwrites its buffers, and Rerun encodes what
it is handed later, on another thread. So the arrays of a block are filled once, handed over, and never written again:
the next block has new ones.
"""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from service.recording.colors import Colors, displacement_colors
from service.recording.layers import LAYERS
from service.recording.legend import FORCE_ARROW_M_PER_N
from service.recording.plots import PLOTS, Moment, Step

if TYPE_CHECKING:
    from service.recording.entities import Drawing
    from simcore.arrays import Floats
    from simcore.rollout.records import StepRecord

Vector32 = NDArray[np.float32]
Coloured = tuple[Vector32, Colors]  # positions (v, 3) m and colours (v,) of the nodes of a mesh

BLOCK_STEPS = 100


class Frame(NamedTuple):
    """How the tissue is drawn at one row; built at once, so that the work is spread over the steps."""

    row: int
    surface: Coloured
    section: Coloured
    edges: Vector32  # (e, 2, 3)
    layers: tuple[Colors, ...]  # of the section, one for each of LAYERS

    @classmethod
    def of(cls, drawing: Drawing, row: int, nodes_m: Floats) -> Frame:
        """Of the tissue's nodes (n, 3) m."""
        outer, cut = drawing.surface, drawing.section
        shell = _coloured(nodes_m.take(outer.nodes, axis=0), drawing.surface_rest_m)
        plane = _coloured(cut.positions(nodes_m), drawing.section_rest_m)
        edges = nodes_m.take(outer.edges, axis=0).astype(np.float32)
        return cls(row, shell, plane, edges, drawing.strain.colors(nodes_m))


def _coloured(moved_m: Floats, rest_m: Floats) -> Coloured:
    return moved_m.astype(np.float32), displacement_colors(moved_m - rest_m)


class Block:
    """Copies of up to `capacity` consecutive records, as rows."""

    def __init__(
        self,
        drawing: Drawing,
        *,
        before: Moment | None = None,
        trail: Vector32 | None = None,
        capacity: int = BLOCK_STEPS,
    ) -> None:
        self.drawing, self.before = drawing, before
        self.rows = 0
        self.carried = np.empty((0, 3), np.float32) if trail is None else trail  # tips since the last tissue frame
        self.steps = np.empty(capacity, np.int64)
        self.times_ns = np.empty(capacity, "timedelta64[ns]")
        self.plots: list[list[tuple[float, ...]]] = [[] for _ in PLOTS]
        self.tips, self.targets = np.empty((capacity, 3), np.float32), np.empty((capacity, 3), np.float32)
        self.shafts: Vector32 | None = None  # (capacity, k, 3)
        self.points: list[Vector32] = []
        self.forces: list[Vector32] = []
        self.frames: list[Frame] = []
        self.limited: list[Vector32] = []  # where the base was held back: one point, or none

    @property
    def full(self) -> bool:
        """Whether there is no room for another record."""
        return self.rows == len(self.steps)

    def add(self, r: StepRecord) -> None:
        """Append a copy of a record; one that cannot be drawn raises ValueError and leaves the rows as they were."""
        row, now = self.rows, Moment.of(r)
        before = self.before or now
        if self.shafts is None:
            self.shafts = np.empty((len(self.steps), *r.shaft_m.shape), np.float32)
        self.shafts[row], self.tips[row], self.targets[row] = r.shaft_m, r.tip_m, r.target_m
        self.steps[row], self.times_ns[row] = r.step, round(r.t_s * 1e9)
        step = Step(r, now, before, self.drawing.scene.scenario.dt_s)
        values = [plot.values(step) for plot in PLOTS]
        for rows, value in zip(self.plots, values, strict=True):
            rows.append(value)
        self.points.append(r.points_m.astype(np.float32))
        self.forces.append(r.point_forces_n.astype(np.float32))
        self.limited.append(np.array([r.base_position_m] if r.limited else np.empty((0, 3)), np.float32))
        if r.tissue_m is not None:
            self.frames.append(Frame.of(self.drawing, row, r.tissue_m))
        self.rows, self.before = row + 1, now

    def next(self) -> Block:
        """The empty block that follows this one."""
        tips = self._tips()
        seen = len(self.carried) + self.frames[-1].row if self.frames else 0
        return Block(self.drawing, before=self.before, trail=tips[seen:], capacity=len(self.steps))

    def _tips(self) -> Vector32:
        """Those carried over from the block before, then one a row."""
        return np.concatenate([self.carried, self.tips[: self.rows]])

    def send(self, stream: rr.RecordingStream) -> None:
        """Send every row, as columns of arrays that are not written again. Call it once, as the last use of a block."""
        assert self.shafts is not None
        n = self.rows
        index = self._index(slice(n))
        for plot, rows in zip(PLOTS, self.plots, strict=True):
            columns = rr.Scalars.columns(scalars=np.array(rows).ravel())
            stream.send_columns(plot.entity, index, columns.partition([len(plot.series)] * n))
        stream.send_columns("world/tip", index, rr.Points3D.columns(positions=self.tips[:n]))
        stream.send_columns("world/target", index, rr.Points3D.columns(positions=self.targets[:n]))
        stream.send_columns("world/needle", index, rr.LineStrips3D.columns(strips=self.shafts[:n]))
        lengths = [len(p) for p in self.points]
        origins, vectors = np.concatenate(self.points), np.concatenate(self.forces) * np.float32(FORCE_ARROW_M_PER_N)
        stream.send_columns("world/points", index, rr.Points3D.columns(positions=origins).partition(lengths))
        arrows = rr.Arrows3D.columns(origins=origins, vectors=vectors)
        stream.send_columns("world/forces", index, arrows.partition(lengths))
        held = rr.Points3D.columns(positions=np.concatenate(self.limited))
        stream.send_columns("world/limited", index, held.partition([len(points) for points in self.limited]))
        if self.frames:
            self._send_tissue(stream)

    def _send_tissue(self, stream: rr.RecordingStream) -> None:
        rows = [frame.row for frame in self.frames]
        index = self._index(rows)
        stream.send_columns("world/tissue/surface", index, _mesh_columns([frame.surface for frame in self.frames]))
        stream.send_columns("world/tissue/section", index, _mesh_columns([frame.section for frame in self.frames]))
        for number, layer in enumerate(LAYERS):
            coloured = [(frame.section[0], frame.layers[number]) for frame in self.frames]
            stream.send_columns(f"world/tissue/{layer}", index, _mesh_columns(coloured))
        edges = np.concatenate([frame.edges for frame in self.frames])
        lines = rr.LineStrips3D.columns(strips=edges)
        stream.send_columns("world/tissue/edges", index, lines.partition([len(frame.edges) for frame in self.frames]))
        tips = self._tips()
        ends = [len(self.carried) + row for row in rows]
        trails = [tips[first : last + 1] for first, last in pairwise([0, *ends])]
        stream.send_columns("world/trail", index, rr.LineStrips3D.columns(strips=trails))

    def _index(self, rows: slice | list[int]) -> list[rr.TimeColumn]:
        return [
            rr.TimeColumn("step", sequence=self.steps[rows]),
            rr.TimeColumn("t", duration=self.times_ns[rows]),
        ]


def _mesh_columns(frames: list[Coloured]) -> rr.ComponentColumnList:
    """Positions and displacement colours of one mesh over several frames."""
    positions, colors = (np.concatenate(arrays) for arrays in zip(*frames, strict=True))
    columns = rr.Mesh3D.columns(vertex_positions=positions, vertex_colors=colors)
    return columns.partition([len(moved) for moved, _ in frames])
