"""Recordings of several jobs as one: their scenes side by side under one time cursor, their plots on top of each other.

Run as a program it does the work in a process of its own: `python -m service.recording.together OUT NAME=FILE ...`.
"""

from __future__ import annotations

import subprocess
import sys
import warnings
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from service.recording.viewer import check_readable, environment
from simcore.errors import NeedlebenchError

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    import rerun.blueprint as rrb
    from rerun.chunk import Chunk

FEWEST, MOST = 2, 6
_KEPT = ("/world", "/metrics", "/timing", "/job")
_TIMEOUT_S = 600.0


class TogetherError(NeedlebenchError):
    """The recordings could not be put together; says why."""


def combine(recordings: Sequence[tuple[str, Path]], target: Path) -> None:
    """Write one recording from FEWEST to MOST of them, each (name, file), in a process of its own.

    Raises ViewerError for a file that cannot be read, TogetherError for too few or too many.
    """
    if not FEWEST <= len(recordings) <= MOST:
        raise TogetherError(f"{len(recordings)} recordings: must be {FEWEST} to {MOST}")
    for _, path in recordings:
        check_readable(path)
    named = [f"{name}={path}" for name, path in recordings]
    command = [sys.executable, "-m", "service.recording.together", str(target), *named]
    try:
        done = subprocess.run(
            command, env=environment(), capture_output=True, text=True, timeout=_TIMEOUT_S, check=False
        )
    except subprocess.TimeoutExpired:
        raise TogetherError(f"it took longer than {_TIMEOUT_S:g} s") from None
    if done.returncode:
        raise TogetherError(done.stderr.strip()[-1000:] or f"it ended with {done.returncode}")


def write(recordings: Mapping[str, Path], target: Path) -> None:
    """Write one recording in this process. recordings: name of each, as it is shown -> its file."""
    import rerun as rr

    from service.recording.plots import PLOTS
    from service.recording.rerun_overrides import end_threads, write_to_file

    rr.set_strict_mode(True)
    stream = rr.RecordingStream("needlebench", recording_id=f"together-{'-'.join(map(_root, range(len(recordings))))}")
    stream.set_log_time_enabled(False)
    stream.set_log_tick_enabled(False)
    write_to_file(stream, target, _blueprint(list(recordings), _eye_on(next(iter(recordings.values())))), "needlebench")
    stream.send_recording_name(", ".join(recordings))
    for number, (name, path) in enumerate(recordings.items()):
        for chunk in _chunks(path, number):
            rr.send_chunks(chunk, recording=stream)
        for plot in PLOTS:
            entity = f"{_root(number)}/{plot.entity}"
            names = [f"{name}: {series}" for series, _ in plot.series]
            widths = [2.0 if first == 0 else 1.0 for first in range(len(names))]
            lines = rr.SeriesLines(names=names, colors=[_color(number)] * len(names), widths=widths)
            stream.log(entity, lines, static=True)
    stream.flush()
    stream.disconnect()
    del stream
    end_threads()


def _chunks(path: Path, number: int) -> Iterator[Chunk]:
    """What is drawn of a recording, under the root of its number; names of series and properties left out."""
    from rerun.chunk import RrdReader

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # a recording that was cut short lacks its footer
        for chunk in RrdReader(path).stream():
            entity = chunk.entity_path
            plotted = entity.startswith(("/metrics", "/timing"))
            if entity.startswith(_KEPT) and not (plotted and chunk.is_static):
                yield chunk.with_entity_path(f"/{_root(number)}{entity}")


def _eye_on(path: Path) -> rrb.EyeControls3D | None:
    """Where the first recording is looked at from; None where it has no tissue yet."""
    from rerun.chunk import RrdReader

    from service.recording.layout import eye_on

    parts: dict[str, np.ndarray] = {}
    wanted = {"/world/path": "LineStrips3D:strips", "/world/needle": "LineStrips3D:strips"}
    wanted["/world/tissue/surface"] = "Mesh3D:vertex_positions"
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        for chunk in RrdReader(path).stream():
            name = wanted.get(chunk.entity_path)
            batch = None if name is None or chunk.entity_path in parts else chunk.to_record_batch()
            if batch is not None and name in batch.schema.names:
                parts[chunk.entity_path] = np.array(batch.column(name)[0].as_py(), float).reshape(-1, 3)
    if len(parts) < len(wanted):
        return None
    return eye_on(np.vstack([parts["/world/tissue/surface"], parts["/world/needle"]]), parts["/world/path"])


def _root(number: int) -> str:
    return f"run{number + 1}"


def _color(number: int) -> tuple[int, int, int]:
    from service.recording.colors import CYAN, GREEN, MAGENTA, ORANGE, WHITE, YELLOW

    return (ORANGE, CYAN, GREEN, MAGENTA, YELLOW, WHITE)[number]


def _blueprint(names: Sequence[str], eye: rrb.EyeControls3D | None) -> rrb.Blueprint:
    import rerun.blueprint as rrb  # half a second and 90 MB that the service need not pay

    from service.recording.layout import scene_view

    def plot(group: str, title: str) -> rrb.TimeSeriesView:
        contents = [f"+ /{_root(number)}/metrics/{group}" for number in range(len(names))]
        legend = rrb.PlotLegend(rrb.Corner2D.LeftTop)
        return rrb.TimeSeriesView(origin="/", contents=contents, name=title, plot_legend=legend)

    scenes = [
        scene_view("displacement", root=f"/{_root(number)}", title=f"{name}: tissue displacement", eye=eye)
        for number, name in enumerate(names)
    ]
    plots = [plot("error", "Errors"), plot("forces", "Forces"), plot("tissue", "Tissue"), plot("depth", "Depth")]
    return rrb.Blueprint(
        rrb.Vertical(rrb.Grid(*scenes), rrb.Horizontal(*plots), row_shares=[3, 2]),
        rrb.BlueprintPanel(state="hidden"),
        rrb.SelectionPanel(state="hidden"),
        rrb.TimePanel(state="collapsed", timeline="t"),
        auto_layout=False,
        auto_views=False,
    )


def distinct(names: Sequence[str]) -> list[str]:
    """Names by which recordings are told apart: a number is added where two are the same."""
    return [name if names.count(name) == 1 else f"{name} ({number})" for number, name in enumerate(names, start=1)]


def main() -> None:
    """What the process of its own does."""
    target, *named = sys.argv[1:]
    pairs = [one.rpartition("=") for one in named]
    write({name: Path(path) for name, _, path in pairs}, Path(target))


if __name__ == "__main__":
    main()
