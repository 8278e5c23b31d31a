"""The data set that learned controllers are trained on: the variables of the paper's table I at every step.

| paper | here | what |
| --- | --- | --- |
| P | base_position_m | end-effector at the beginning of the step |
| T | command_position_m | commanded position, before the robot's limits |
| n | tip_m | tip at the beginning of the step, as the controller saw it |
| n~_traj | target_noisy_m | target that the controller saw |
| Delta P | base_step_m | T - P: the outputs of the paper's ELM |
| e~_p | tip_error_m | n~_traj - n: with P the inputs of the paper's ELM |

All (rows, 3) m, world frame. A row is one step of one insertion.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from simcore.arrays import Floats, Ints
from simcore.errors import ARCHIVE_ERRORS, NeedlebenchError
from simcore.rollout.artefacts import replace_atomically

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    from numpy.typing import NDArray

Table = dict[str, Floats]

FORMAT = "needlebench/dataset/1"
VARIABLES = ("base_position_m", "command_position_m", "tip_m", "target_noisy_m", "base_step_m", "tip_error_m")
SAMPLES = 10_000  # [paper]
TRAINING_SHARE = 0.9  # [paper]
MAXIMUM_MB = 2000


class DatasetError(NeedlebenchError, ValueError):
    """A file that is no data set, or one that cannot be made; the message says why."""


def table_one(series: Mapping[str, NDArray[Any]]) -> Table:
    """The variables of table I, (steps, 3) m each, from a rollout's series."""
    base, command = series["base_position_m"][:-1], series["command_position_m"][1:]
    tip, target = series["tip_seen_m"][:-1], series["target_noisy_m"][:-1]
    return dict(zip(VARIABLES, (base, command, tip, target, command - base, target - tip), strict=True))


@dataclass(frozen=True)
class Split:
    """Rows for training and for the test (n,), in ascending order."""

    train: Ints
    test: Ints


@dataclass(frozen=True)
class Dataset:
    """Rows of all insertions, one after the other.

    trajectory, step: (rows,) which insertion and which step of it. end_point_m: (insertions, 3) m. drawn: (samples,)
    rows that the seed drew, ascending. seed: of the draw and of both splits. provenance: JSON data.
    """

    variables: Table
    trajectory: Ints
    step: Ints
    end_point_m: Floats
    drawn: Ints
    seed: int
    provenance: dict[str, Any]

    @cached_property
    def by_sample(self) -> Split:
        """90 / 10 over the drawn rows [paper]; neighbours in time fall on both sides."""
        rows = np.random.default_rng([self.seed, 1]).permutation(self.drawn)
        return _split(rows, round(TRAINING_SHARE * len(rows)))

    @cached_property
    def by_trajectory(self) -> Split:
        """90 / 10 over the insertions: no row of a test insertion is learned. Needs two insertions."""
        numbers = np.random.default_rng([self.seed, 2]).permutation(len(self.end_point_m))
        held_out = numbers[: max(1, round((1.0 - TRAINING_SHARE) * len(numbers)))]
        tested = np.isin(self.trajectory[self.drawn], held_out)
        return Split(self.drawn[~tested], self.drawn[tested])

    def inputs(self, rows: Ints) -> Floats:
        """X (n, 6) m: P, e~_p."""
        return np.hstack([self.variables["base_position_m"][rows], self.variables["tip_error_m"][rows]])

    def outputs(self, rows: Ints) -> Floats:
        """Y (n, 3) m: Delta P."""
        return self.variables["base_step_m"][rows]

    def arrays(self) -> dict[str, NDArray[Any]]:
        """The content of its file."""
        return {
            **self.variables,
            "trajectory": self.trajectory,
            "step": self.step,
            "end_point_m": self.end_point_m,
            "drawn": self.drawn,
            "train_by_sample": self.by_sample.train,
            "test_by_sample": self.by_sample.test,
            "train_by_trajectory": self.by_trajectory.train,
            "test_by_trajectory": self.by_trajectory.test,
            "seed": np.array(self.seed),
            "format": np.array(FORMAT),
            "provenance": np.array(json.dumps(self.provenance, allow_nan=False)),
        }


def _split(rows: Ints, first: int) -> Split:
    return Split(np.sort(rows[:first]), np.sort(rows[first:]))


def gathered(
    tables: Sequence[Table], end_points_m: Floats, *, samples: int, seed: int, provenance: dict[str, Any]
) -> Dataset:
    """The data set of these insertions; as many samples as asked for, or all rows if there are fewer.

    Raises DatasetError without a row.
    """
    lengths = [len(table["tip_m"]) for table in tables]
    rows = sum(lengths)
    if rows == 0:
        raise DatasetError("no insertion made a step: there is nothing to learn from")
    drawn = np.random.default_rng([seed, 0]).permutation(rows)[: min(samples, rows)]
    return Dataset(
        variables={name: np.concatenate([table[name] for table in tables]) for name in VARIABLES},
        trajectory=np.repeat(np.arange(len(tables)), lengths),
        step=np.concatenate([np.arange(length) for length in lengths]),
        end_point_m=end_points_m,
        drawn=np.sort(drawn),
        seed=seed,
        provenance=provenance,
    )


def save_dataset(data: Dataset, path: Path) -> None:
    """Write the file as a whole or not at all."""
    replace_atomically(path, lambda file: np.savez_compressed(file, allow_pickle=False, **data.arrays()))


def load_dataset(path: Path) -> Dataset:
    """Read and check a file. Raises DatasetError: another format, arrays that do not fit, rows that are not finite."""
    try:
        if path.stat().st_size > MAXIMUM_MB * 1_000_000:
            raise DatasetError(f"{path} holds {path.stat().st_size / 1e6:.0f} MB, at most {MAXIMUM_MB} are allowed")
        with path.open("rb") as file:
            archive = np.load(file, allow_pickle=False)
            if not isinstance(archive, np.lib.npyio.NpzFile):
                raise DatasetError(f"{path} cannot be read as a data set: it is one array and no archive")
            found = {name: archive[name] for name in archive.files}
    except DatasetError:
        raise
    except ARCHIVE_ERRORS as error:
        reason = getattr(error, "strerror", None) or error
        if "pickle" in str(reason):
            reason = "it is no archive of plain arrays"
        raise DatasetError(f"{path} cannot be read as a data set: {reason}") from None
    if str(found.get("format")) != FORMAT:
        raise DatasetError(f"{path} is not a data set: its format is {found.get('format')}, not {FORMAT}")
    _check(path, found)
    return Dataset(
        variables={name: found[name] for name in VARIABLES},
        trajectory=found["trajectory"],
        step=found["step"],
        end_point_m=found["end_point_m"],
        drawn=found["drawn"],
        seed=int(found["seed"]),
        provenance=json.loads(str(found["provenance"])),
    )


def _check(path: Path, found: dict[str, NDArray[Any]]) -> None:
    needed = (*VARIABLES, "trajectory", "step", "end_point_m", "drawn", "seed", "provenance")
    missing = [name for name in needed if name not in found]
    if missing:
        raise DatasetError(f"{path} lacks the arrays {', '.join(missing)}")
    rows = found["trajectory"].size
    _check_numbers(path, found, rows)
    for name in VARIABLES:
        array = found[name]
        if array.shape != (rows, 3) or array.dtype != np.float64:
            raise DatasetError(f"{path}: {name} is {array.dtype} {array.shape}, not float64 ({rows}, 3)")
        bad = int((~np.isfinite(array).all(axis=1)).sum())
        if bad:
            raise DatasetError(f"{path}: {name} has {bad} rows that are not finite")


def _check_numbers(path: Path, found: dict[str, NDArray[Any]], rows: int) -> None:
    """Everything but the variables, which have as many rows."""
    for name in ("trajectory", "step"):
        array = found[name]
        if array.shape != (rows,) or array.dtype.kind != "i" or array.min(initial=0) < 0:
            raise DatasetError(f"{path}: {name} must hold {rows} whole numbers from 0")
    drawn = found["drawn"]
    if drawn.ndim != 1 or drawn.dtype.kind != "i" or not drawn.size or drawn.min() < 0 or drawn.max() >= rows:
        raise DatasetError(f"{path}: drawn must hold row numbers, 0 to {rows - 1}")
    points = found["end_point_m"]
    if points.ndim != 2 or points.shape[1] != 3 or points.dtype.kind != "f" or not np.isfinite(points).all():
        raise DatasetError(f"{path}: end_point_m must be a finite table (insertions, 3)")
    if found["trajectory"].max(initial=-1) >= len(points):
        raise DatasetError(f"{path}: trajectory names more insertions than the {len(points)} of end_point_m")
    if found["seed"].shape or found["seed"].dtype.kind != "i" or found["seed"] < 0:
        raise DatasetError(f"{path}: seed must be a whole number from 0")
    try:
        told = json.loads(str(found["provenance"]))
    except (ValueError, RecursionError):
        told = None
    if not isinstance(told, dict):
        raise DatasetError(f"{path}: provenance must be a JSON object")
