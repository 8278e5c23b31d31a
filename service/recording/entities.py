"""The entities of a recording that never change: axes, path, colours, radii, meshes, names of the series. Metres."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import rerun as rr

from service.recording.colors import GREEN, GREY, MAGENTA, ORANGE, RED, STEEL, WHITE, YELLOW
from service.recording.layers import LAYERS, SectionStrain
from service.recording.legend import legend
from service.recording.plots import PLOTS
from service.recording.section import Section, Surface, section, surface

if TYPE_CHECKING:
    from simcore.arrays import Floats
    from simcore.rollout.records import Scene

SECTION_BEHIND_M = 3e-3  # so that it does not cut the needle in half


@dataclass(frozen=True)
class Drawing:
    """The constant part of a drawn scene."""

    scene: Scene
    surface: Surface
    section: Section
    surface_rest_m: Floats  # (v, 3) of the surface's nodes
    section_rest_m: Floats  # (s, 3) of the section's points
    strain: SectionStrain

    @classmethod
    def of(cls, scene: Scene) -> Drawing:
        """The drawing of a scene: its surface, and its section along the path."""
        rest = scene.tissue_rest_m
        outer = surface(rest, scene.surface_triangles)
        cut = section(rest, scene.tissue_tets, scene.path_m, behind_m=SECTION_BEHIND_M)
        strain = SectionStrain.of(cut, rest, scene.tissue_tets, scene.scenario.tissue)
        return cls(scene, outer, cut, rest[outer.nodes], cut.positions(rest), strain)


def log_static(stream: rr.RecordingStream, scene: Scene, drawing: Drawing) -> None:
    """Everything that is sent once: axes, path, colours, radii, mesh connectivity, names of the series."""
    outer, cut = drawing.surface, drawing.section
    needle = scene.needle_radius_m
    static: dict[str, rr.AsComponents] = {
        "world/path": rr.LineStrips3D([scene.path_m], radii=0.3e-3, colors=[GREEN]),
        "world/entry": rr.Points3D([scene.entry_m], radii=1.5e-3, colors=[WHITE]),
        "world/needle": rr.LineStrips3D.from_fields(radii=needle, colors=[STEEL]),
        "world/tip": rr.Points3D.from_fields(radii=1.6 * needle, colors=[ORANGE]),
        "world/target": rr.Points3D.from_fields(radii=2.4 * needle, colors=[GREEN]),
        "world/trail": rr.LineStrips3D.from_fields(radii=0.35 * needle, colors=[ORANGE]),
        "world/points": rr.Points3D.from_fields(radii=0.8e-3, colors=[YELLOW]),
        "world/forces": rr.Arrows3D.from_fields(radii=0.3e-3, colors=[MAGENTA]),
        "world/tissue/surface": rr.Mesh3D.from_fields(
            triangle_indices=outer.triangles.astype(np.uint32),
            vertex_normals=outer.normals.astype(np.float32),
            albedo_factor=(255, 255, 255, 45),
        ),
        "world/tissue/held": rr.Points3D(scene.tissue_rest_m[scene.held_nodes], radii=0.7e-3, colors=[GREY]),
        "world/tissue/edges": rr.LineStrips3D.from_fields(radii=0.25e-3, colors=[GREY]),
        "world/limited": rr.Points3D.from_fields(
            radii=1.2e-3, colors=[RED], labels=["held back by the robot's limits"], show_labels=True
        ),
        **{f"world/tissue/{layer}": _textured(cut) for layer in ("section", *LAYERS)},
        **legend(scene),
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
