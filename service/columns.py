"""The entities of a recording: what each shows, how a step becomes a row, how a block of steps becomes columns.

Positions are in metres, plots in the unit that their series names give. Everything is copied on arrival: the
simulation overwrites its buffers, and Rerun encodes what it is handed later, on another thread.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from service.blueprint import DISPLACEMENT_SCALE_M
from service.tissue_view import Section, Surface, section, surface
from simcore.records import Scene, StepRecord, Vector

Vector32 = NDArray[np.float32]

BLOCK_STEPS = 50
FORCE_ARROW_M_PER_N = 0.05
SECTION_BEHIND_M = 3e-3  # so that it does not cut the needle in half

_WHITE, _STEEL, _CYAN, _ORANGE = (245, 247, 250), (205, 214, 226), (80, 220, 235), (255, 150, 50)
_GREEN, _MAGENTA, _YELLOW, _GREY = (90, 220, 120), (240, 90, 200), (250, 215, 80), (150, 160, 175)
_COLOR_LEVELS = np.linspace(0.0, 1.0, 5)
_COLOR_MAP = np.array([[58, 76, 110], [48, 132, 150], [120, 190, 110], [248, 208, 80], [240, 84, 60]], float)


class Before(NamedTuple):
    """What a plot needs of the step before."""

    position_m: Vector  # (3,) of the base
    rotation: Vector  # (4,) of the base
    target_m: Vector  # (3,)

    @classmethod
    def of(cls, r: StepRecord) -> Before:
        """A copy of what a record holds."""
        return cls(np.array(r.base_position_m), np.array(r.base_rotation), np.array(r.target_m))


@dataclass(frozen=True)
class Plot:
    """One entity with one or more series; `values` maps a record and the pose before it to one number a series."""

    entity: str
    series: tuple[tuple[str, tuple[int, int, int]], ...]  # name with its unit, colour
    values: Callable[[StepRecord, Before, float], tuple[float, ...]]


def _errors(r: StepRecord, before: Before, dt_s: float) -> tuple[float, ...]:
    """The tip against the target that its command was made for: the definition behind rmse_mm."""
    return 1e3 * math.dist(r.tip_m, before.target_m), 1e3 * r.rcm_error_m


def _depth(r: StepRecord, before: Before, dt_s: float) -> tuple[float, ...]:
    return (1e3 * r.depth_m,)


def _tissue(r: StepRecord, before: Before, dt_s: float) -> tuple[float, ...]:
    return (1e3 * r.max_displacement_m,)


def _forces(r: StepRecord, before: Before, dt_s: float) -> tuple[float, ...]:
    lateral = float(r.base_force_n @ r.base_force_n) - r.insertion_force_n**2
    return r.insertion_force_n, math.sqrt(max(0.0, lateral))


def _command(r: StepRecord, before: Before, dt_s: float) -> tuple[float, ...]:
    asked = math.dist(r.command_position_m, before.position_m) / dt_s
    moved = math.dist(r.base_position_m, before.position_m) / dt_s
    half = 0.5 * min(math.dist(r.base_rotation, before.rotation), math.dist(r.base_rotation, -before.rotation))
    return 1e3 * asked, 1e3 * moved, math.degrees(4 * math.asin(min(1.0, half))) / dt_s, float(r.limited)


def _solver(r: StepRecord, before: Before, dt_s: float) -> tuple[float, ...]:
    return float(r.iterations), math.log10(max(r.residual_n, 1e-16))


def _timing(r: StepRecord, before: Before, dt_s: float) -> tuple[float, ...]:
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

    @classmethod
    def of(cls, scene: Scene) -> Drawing:
        rest = scene.tissue_rest_m
        cut = section(rest, scene.tissue_tets, scene.path_m, behind_m=SECTION_BEHIND_M)
        return cls(scene, surface(rest, scene.surface_triangles), cut)


def displacement_colors(moved_m: Vector) -> NDArray[np.uint8]:
    """(n, 3) colours of displacements (n, 3) m, from none to DISPLACEMENT_SCALE_M and beyond."""
    level = np.linalg.norm(moved_m, axis=1) / DISPLACEMENT_SCALE_M
    channels = [np.interp(level, _COLOR_LEVELS, _COLOR_MAP[:, channel]) for channel in range(3)]
    return np.stack(channels, axis=1).astype(np.uint8)


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
    near = np.minimum(np.abs(x - np.rint(x))[None, :], np.abs(y - np.rint(y))[:, None]) * every_mm
    shade = np.where(near < 0.2, 110, 255).astype(np.uint8)
    picture = np.repeat(shade[:, :, None], 3, axis=2)
    return rr.Mesh3D.from_fields(
        triangle_indices=cut.triangles.astype(np.uint32),
        vertex_texcoords=((cut.plane_m - low) / (high - low)).astype(np.float32),
        albedo_texture_buffer=picture.tobytes(),
        albedo_texture_format=rr.components.ImageFormat(
            width=width, height=height, color_model="RGB", channel_datatype="U8"
        ),
    )


@dataclass
class Block:
    """Copies of a number of consecutive records, as rows."""

    drawing: Drawing
    before: Before | None = None
    trail: list[Vector32] = field(default_factory=list)  # tips since the last tissue frame
    steps: list[int] = field(default_factory=list)
    times_ns: list[int] = field(default_factory=list)
    plots: list[list[tuple[float, ...]]] = field(default_factory=lambda: [[] for _ in PLOTS])
    vectors: list[tuple[Vector32, ...]] = field(default_factory=list)  # tip, target, shaft, points, forces
    frames: list[tuple[int, Vector, Vector32]] = field(default_factory=list)  # row, tissue nodes, trail

    def __len__(self) -> int:
        return len(self.steps)

    def add(self, r: StepRecord) -> None:
        """Append a copy of a record."""
        before = self.before or Before.of(r)
        self.steps.append(r.step)
        self.times_ns.append(round(r.t_s * 1e9))
        for rows, plot in zip(self.plots, PLOTS, strict=True):
            rows.append(plot.values(r, before, self.drawing.scene.scenario.dt_s))
        copies = [np.array(v, np.float32) for v in (r.tip_m, r.target_m, r.shaft_m, r.points_m, r.point_forces_n)]
        self.vectors.append(tuple(copies))
        self.trail.append(copies[0])
        if r.tissue_m is not None:
            self.frames.append((len(self.steps) - 1, np.array(r.tissue_m), np.array(self.trail)))
            self.trail = [copies[0]]
        self.before = Before.of(r)

    def next(self) -> Block:
        """The empty block that follows this one."""
        return Block(self.drawing, before=self.before, trail=self.trail)

    def send(self, stream: rr.RecordingStream) -> None:
        """Send every row, as columns of arrays that nobody else holds."""
        index = self._index(range(len(self)))
        for plot, rows in zip(PLOTS, self.plots, strict=True):
            columns = rr.Scalars.columns(scalars=np.array(rows).ravel())
            stream.send_columns(plot.entity, index, columns.partition([len(plot.series)] * len(self)))
        tips, targets, shafts, points, forces = zip(*self.vectors, strict=True)
        stream.send_columns("world/tip", index, rr.Points3D.columns(positions=np.array(tips)))
        stream.send_columns("world/target", index, rr.Points3D.columns(positions=np.array(targets)))
        stream.send_columns("world/needle", index, rr.LineStrips3D.columns(strips=np.array(shafts)))
        lengths = [len(p) for p in points]
        origins, vectors = np.concatenate(points), np.concatenate(forces) * np.float32(FORCE_ARROW_M_PER_N)
        stream.send_columns("world/points", index, rr.Points3D.columns(positions=origins).partition(lengths))
        arrows = rr.Arrows3D.columns(origins=origins, vectors=vectors)
        stream.send_columns("world/forces", index, arrows.partition(lengths))
        if self.frames:
            self._send_tissue(stream)

    def _send_tissue(self, stream: rr.RecordingStream) -> None:
        rows, tissues, trails = zip(*self.frames, strict=True)
        index = self._index(rows)
        rest, outer, cut = self.drawing.scene.tissue_rest_m, self.drawing.surface, self.drawing.section
        shells = [(nodes[outer.nodes], rest[outer.nodes]) for nodes in tissues]
        cuts = [(cut.positions(nodes), cut.positions(rest)) for nodes in tissues]
        stream.send_columns("world/tissue/surface", index, _mesh_columns(shells))
        stream.send_columns("world/tissue/section", index, _mesh_columns(cuts))
        edges = np.concatenate([nodes[outer.edges] for nodes in tissues]).astype(np.float32)
        lines = rr.LineStrips3D.columns(strips=edges)
        stream.send_columns("world/tissue/edges", index, lines.partition([len(outer.edges)] * len(rows)))
        stream.send_columns("world/trail", index, rr.LineStrips3D.columns(strips=list(trails)))

    def _index(self, rows: range | tuple[int, ...]) -> list[rr.TimeColumn]:
        steps = np.array([self.steps[row] for row in rows])
        times = np.array([self.times_ns[row] for row in rows]).astype("timedelta64[ns]")
        return [rr.TimeColumn("step", sequence=steps), rr.TimeColumn("t", duration=times)]


def _mesh_columns(frames: list[tuple[Vector, Vector]]) -> rr.ComponentColumnList:
    """Positions and displacement colours of one mesh over several frames of (moved, rest) nodes."""
    positions = np.concatenate([moved for moved, _ in frames]).astype(np.float32)
    colors = np.concatenate([displacement_colors(moved - rest) for moved, rest in frames])
    columns = rr.Mesh3D.columns(vertex_positions=positions, vertex_colors=colors)
    return columns.partition([len(moved) for moved, _ in frames])
