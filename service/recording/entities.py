"""The entities of a recording: what each shows, how a step becomes a row, how a block of steps becomes columns.

Positions are in metres, plots in the unit that their series names give. Everything is copied on arrival: the
simulation overwrites its buffers, and Rerun encodes what it is handed later, on another thread. So a block's own
arrays are filled once, handed over, and never written again: the next block has new ones.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from service.recording.layout import DISPLACEMENT_SCALE_M
from service.recording.section import Section, Surface, section, surface
from simcore.arrays import Floats
from simcore.rollout.records import Scene, StepRecord

Vector32 = NDArray[np.float32]
Colors = NDArray[np.uint32]
Coloured = tuple[Vector32, Colors]  # positions (v, 3) m and colours (v,) of the nodes of a mesh

BLOCK_STEPS = 100
FORCE_ARROW_M_PER_N = 0.05
SECTION_BEHIND_M = 3e-3  # so that it does not cut the needle in half

_WHITE, _STEEL, _CYAN, _ORANGE = (245, 247, 250), (205, 214, 226), (80, 220, 235), (255, 150, 50)
_GREEN, _MAGENTA, _YELLOW, _GREY = (90, 220, 120), (240, 90, 200), (250, 215, 80), (150, 160, 175)
_COLOR_LEVELS = np.linspace(0.0, 1.0, 5)
_COLOR_MAP = np.array([[58, 76, 110], [48, 132, 150], [120, 190, 110], [248, 208, 80], [240, 84, 60]], float)


class Moment(NamedTuple):
    """The vectors of a record that its plots compare, as lists: math on three numbers is slow on arrays."""

    position_m: list[float]  # (3,) of the base
    rotation: list[float]  # (4,) of the base
    tip_m: list[float]  # (3,)
    target_m: list[float]  # (3,)
    command_m: list[float]  # (3,) the base that was asked for

    @classmethod
    def of(cls, r: StepRecord) -> Moment:
        """A copy of what a record holds."""
        vectors = r.base_position_m, r.base_rotation, r.tip_m, r.target_m, r.command_position_m
        return cls(*(vector.tolist() for vector in vectors))


@dataclass(frozen=True)
class Plot:
    """One entity with one or more series; `values` maps a record, its moment and that before to a number a series."""

    entity: str
    series: tuple[tuple[str, tuple[int, int, int]], ...]  # name with its unit, colour
    values: Callable[[StepRecord, Moment, Moment, float], tuple[float, ...]]


def _errors(r: StepRecord, now: Moment, before: Moment, dt_s: float) -> tuple[float, ...]:
    """The tip against the target that its command was made for: the definition behind rmse_mm."""
    return 1e3 * math.dist(now.tip_m, before.target_m), 1e3 * r.rcm_error_m


def _depth(r: StepRecord, now: Moment, before: Moment, dt_s: float) -> tuple[float, ...]:
    return (1e3 * r.depth_m,)


def _tissue(r: StepRecord, now: Moment, before: Moment, dt_s: float) -> tuple[float, ...]:
    return (1e3 * r.max_displacement_m,)


def _forces(r: StepRecord, now: Moment, before: Moment, dt_s: float) -> tuple[float, ...]:
    lateral = float(r.base_force_n @ r.base_force_n) - r.insertion_force_n**2
    return r.insertion_force_n, math.sqrt(max(0.0, lateral))


def _command(r: StepRecord, now: Moment, before: Moment, dt_s: float) -> tuple[float, ...]:
    asked = math.dist(now.command_m, before.position_m) / dt_s
    moved = math.dist(now.position_m, before.position_m) / dt_s
    opposite = [-component for component in before.rotation]  # the same rotation
    half = 0.5 * min(math.dist(now.rotation, before.rotation), math.dist(now.rotation, opposite))
    return 1e3 * asked, 1e3 * moved, math.degrees(4 * math.asin(min(1.0, half))) / dt_s, float(r.limited)


def _solver(r: StepRecord, now: Moment, before: Moment, dt_s: float) -> tuple[float, ...]:
    return float(r.iterations), math.log10(max(r.residual_n, 1e-16))


def _timing(r: StepRecord, now: Moment, before: Moment, dt_s: float) -> tuple[float, ...]:
    return 1e3 * r.timing.plant_s, 1e3 * r.timing.jacobian_s, 1e3 * r.timing.command_s


PLOTS = (
    Plot("metrics/error", (("tip error, mm", _ORANGE), ("shaft to entry, mm", _CYAN)), _errors),
    Plot("metrics/forces", (("insertion, N", _ORANGE), ("lateral at the base, N", _CYAN)), _forces),
    Plot("metrics/tissue", (("largest tissue displacement, mm", _YELLOW),), _tissue),
    Plot("metrics/depth", (("inserted, mm", _GREEN),), _depth),
    Plot(
        "metrics/command",
        (("asked, mm/s", _ORANGE), ("moved, mm/s", _GREEN), ("turned, deg/s", _CYAN), ("limited", _GREY)),
        _command,
    ),
    Plot("metrics/solver", (("iterations", _GREEN), ("log10 of the residual, N", _CYAN)), _solver),
    Plot("timing/step", (("plant, ms", _ORANGE), ("Jacobian, ms", _CYAN), ("command, ms", _GREEN)), _timing),
)


@dataclass(frozen=True)
class Drawing:
    """What stays the same about how a scene is drawn."""

    scene: Scene
    surface: Surface
    section: Section
    surface_rest_m: Floats  # (v, 3) of the surface's nodes
    section_rest_m: Floats  # (s, 3) of the section's points

    @classmethod
    def of(cls, scene: Scene) -> Drawing:
        rest = scene.tissue_rest_m
        outer = surface(rest, scene.surface_triangles)
        cut = section(rest, scene.tissue_tets, scene.path_m, behind_m=SECTION_BEHIND_M)
        return cls(scene, outer, cut, rest[outer.nodes], cut.positions(rest))


def displacement_colors(moved_m: Floats) -> Colors:
    """(n,) colours 0xRRGGBBAA of displacements (n, 3) m, from none to DISPLACEMENT_SCALE_M and beyond."""
    x, y, z = moved_m.T
    level = np.sqrt(x * x + y * y + z * z) / DISPLACEMENT_SCALE_M
    packed = np.full(level.shape, 0xFF, np.uint32)
    for channel, shift in enumerate((24, 16, 8)):
        packed |= np.interp(level, _COLOR_LEVELS, _COLOR_MAP[:, channel]).astype(np.uint32) << np.uint32(shift)
    return packed


def log_static(stream: rr.RecordingStream, scene: Scene, drawing: Drawing) -> None:
    """Everything that is sent once: axes, path, colours, radii, mesh connectivity, names of the series."""
    outer, cut = drawing.surface, drawing.section
    needle = scene.needle_radius_m
    static: dict[str, rr.AsComponents] = {
        "world/path": rr.LineStrips3D([scene.path_m], radii=0.3e-3, colors=[_GREEN]),
        "world/entry": rr.Points3D([scene.entry_m], radii=1.5e-3, colors=[_WHITE]),
        "world/needle": rr.LineStrips3D.from_fields(radii=needle, colors=[_STEEL]),
        "world/tip": rr.Points3D.from_fields(radii=1.6 * needle, colors=[_ORANGE]),
        "world/target": rr.Points3D.from_fields(radii=2.4 * needle, colors=[_GREEN]),
        "world/trail": rr.LineStrips3D.from_fields(radii=0.35 * needle, colors=[_ORANGE]),
        "world/points": rr.Points3D.from_fields(radii=0.8e-3, colors=[_YELLOW]),
        "world/forces": rr.Arrows3D.from_fields(radii=0.3e-3, colors=[_MAGENTA]),
        "world/tissue/surface": rr.Mesh3D.from_fields(
            triangle_indices=outer.triangles.astype(np.uint32),
            vertex_normals=outer.normals.astype(np.float32),
            albedo_factor=(255, 255, 255, 45),
        ),
        "world/tissue/edges": rr.LineStrips3D.from_fields(radii=0.25e-3, colors=[_GREY]),
        "world/tissue/section": _textured(cut),
    }
    for entity, archetype in static.items():
        stream.log(entity, archetype, static=True)
    for plot in PLOTS:
        names, colors = zip(*plot.series, strict=True)
        stream.log(plot.entity, rr.SeriesLines(names=names, colors=colors, widths=[1.5]), static=True)


def _textured(cut: Section) -> rr.Mesh3D:
    """The section with lines every 5 mm of the rest shape, which move with the material."""
    pixels_per_mm, every_mm = 8, 5
    low, high = cut.plane_m.min(axis=0), cut.plane_m.max(axis=0)
    width, height = np.maximum(8, np.ceil((high - low) * 1e3 * pixels_per_mm)).astype(int)
    x = (low[0] * 1e3 + (np.arange(width) + 0.5) / pixels_per_mm) / every_mm
    y = (low[1] * 1e3 + (np.arange(height) + 0.5) / pixels_per_mm) / every_mm
    lined = [np.abs(axis - np.rint(axis)) * every_mm < 0.2 for axis in (y, x)]
    shade = np.where(np.logical_or.outer(*lined), np.uint8(110), np.uint8(255))
    picture = np.repeat(shade[:, :, None], 3, axis=2)
    return rr.Mesh3D.from_fields(
        triangle_indices=cut.triangles.astype(np.uint32),
        vertex_texcoords=((cut.plane_m - low) / (high - low)).astype(np.float32),
        albedo_texture_buffer=picture.tobytes(),
        albedo_texture_format=rr.components.ImageFormat(
            width=width, height=height, color_model="RGB", channel_datatype="U8"
        ),
    )


class Frame(NamedTuple):
    """How the tissue is drawn at one row; made as it comes, so that the work is spread over the steps."""

    row: int
    surface: Coloured
    section: Coloured
    edges: Vector32  # (e, 2, 3)

    @classmethod
    def of(cls, drawing: Drawing, row: int, nodes_m: Floats) -> Frame:
        """Of the tissue's nodes (n, 3) m."""
        outer, cut = drawing.surface, drawing.section
        shell = _coloured(nodes_m.take(outer.nodes, axis=0), drawing.surface_rest_m)
        plane = _coloured(cut.positions(nodes_m), drawing.section_rest_m)
        return cls(row, shell, plane, nodes_m.take(outer.edges, axis=0).astype(np.float32))


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
        dt_s = self.drawing.scene.scenario.dt_s
        values = [plot.values(r, now, before, dt_s) for plot in PLOTS]
        for rows, value in zip(self.plots, values, strict=True):
            rows.append(value)
        self.points.append(r.points_m.astype(np.float32))
        self.forces.append(r.point_forces_n.astype(np.float32))
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
        """Send every row, as columns of arrays that nobody else writes to. To be done once, as the last of a block."""
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
        if self.frames:
            self._send_tissue(stream)

    def _send_tissue(self, stream: rr.RecordingStream) -> None:
        rows = [frame.row for frame in self.frames]
        index = self._index(rows)
        stream.send_columns("world/tissue/surface", index, _mesh_columns([frame.surface for frame in self.frames]))
        stream.send_columns("world/tissue/section", index, _mesh_columns([frame.section for frame in self.frames]))
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
