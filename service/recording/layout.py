"""How a recording opens: the scene on the left, its plots on the right, the time panel below."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import rerun.blueprint as rrb

from service.recording.layers import LAYERS
from service.recording.legend import legend_corners
from service.recording.section import path_plane

if TYPE_CHECKING:
    from simcore.arrays import Floats
    from simcore.rollout.records import Scene

BACKGROUND = (18, 21, 28)
_EYE_SLOPE = 0.52  # tangent of half the angle that the viewer's eye sees from top to bottom
_EYE_ASPECT = 1.05  # width over height of the view, at least
_EYE_MARGIN = 1.04


def blueprint(scene: Scene) -> rrb.Blueprint:
    """The default layout of a recording of this scene."""
    return rrb.Blueprint(
        rrb.Horizontal(
            rrb.Tabs(
                *(scene_view(layer, eye=_eye(scene)) for layer in ("displacement", *LAYERS)),
                active_tab=0,
            ),
            rrb.Vertical(
                _plot("error", "Errors"),
                _plot("forces", "Forces"),
                _plot("tissue", "Tissue"),
                rrb.Tabs(
                    _plot("command", "Command"),
                    _plot("depth", "Depth"),
                    _plot("solver", "Solver"),
                    rrb.TimeSeriesView(origin="/timing/step", name="Step time"),
                    rrb.TextDocumentView(origin="/job", name="Job"),
                ),
            ),
            column_shares=[3, 2],
        ),
        rrb.BlueprintPanel(state="hidden"),
        rrb.SelectionPanel(state="hidden"),
        rrb.TimePanel(state="collapsed", timeline="t", play_state="following"),  # the end: of a running one, now
        auto_layout=False,
        auto_views=False,
    )


def scene_view(
    layer: str, *, root: str = "", title: str = "", eye: rrb.EyeControls3D | None = None
) -> rrb.Spatial3DView:
    """The scene with the section and the legend of one layer: displacement, strain or stress. root: of its entities."""
    shown = {"displacement": "section"}
    others = [one for one in ("displacement", *LAYERS) if one != layer]
    left_out = [f"- {root}/world/tissue/{shown.get(one, one)}" for one in others]
    left_out += [f"- {root}/world/legend/{one}" for one in others]
    return rrb.Spatial3DView(
        origin=f"{root}/world",
        contents=[f"+ {root}/world/**", *left_out],
        name=title or f"Colour: tissue {layer}",
        background=BACKGROUND,
        line_grid=False,
        eye_controls=eye,
        overrides={f"{root}/world/trail".removeprefix("/"): everything_so_far()},
    )


def _plot(group: str, name: str) -> rrb.TimeSeriesView:
    return rrb.TimeSeriesView(origin=f"/metrics/{group}", name=name, plot_legend=rrb.PlotLegend(rrb.Corner2D.LeftTop))


def everything_so_far() -> rrb.VisibleTimeRanges:
    """From the start to the time cursor: short pieces add up to a trail."""
    start, now = rrb.TimeRangeBoundary.infinite(), rrb.TimeRangeBoundary.cursor_relative()
    return rrb.VisibleTimeRanges([rrb.VisibleTimeRange(line, start=start, end=now) for line in ("t", "step")])


def _eye(scene: Scene) -> rrb.EyeControls3D:
    """Sees the whole block, and the needle before it enters."""
    along = path_plane(scene.path_m)[0]
    base = scene.path_m[0] - along * scene.scenario.needle.length_mm * 1e-3
    return eye_on(np.vstack([scene.tissue_rest_m, base, legend_corners(scene)]), scene.path_m)


def eye_on(points: Floats, path_m: Floats) -> rrb.EyeControls3D:
    """Sees all points (n, 3) m, with the plane of the path (p, 3) m nearly face on."""
    along, across, normal = path_plane(path_m)
    backward = _unit(0.8 * normal + 0.45 * along + 0.4 * across)
    right = _unit(np.cross(across, backward))
    up = np.cross(backward, right)
    slopes = np.array([_EYE_SLOPE * _EYE_ASPECT, _EYE_SLOPE])
    centre: Floats = points.mean(axis=0)
    for _ in range(20):  # centre what is seen; the distance follows from the farthest out
        sideways, depth = (points - centre) @ np.stack([right, up], axis=1), (points - centre) @ backward
        distance = np.max(depth[:, None] + np.abs(sideways) / slopes)
        seen = sideways / (distance - depth)[:, None]
        middle = 0.5 * (seen.min(axis=0) + seen.max(axis=0)) * distance
        centre = centre + middle[0] * right + middle[1] * up
    position = centre + _EYE_MARGIN * distance * backward
    return rrb.EyeControls3D(kind=rrb.Eye3DKind.Orbital, position=position, look_target=centre, eye_up=across)


def _unit(vector: Floats) -> Floats:
    return np.asarray(vector / np.linalg.norm(vector))
