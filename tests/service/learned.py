"""Small data sets and models, as the bytes of their files."""

from __future__ import annotations

import io
import zipfile
from typing import Any

import numpy as np

from benchmarks.learning.training import train_model
from service.worker.training_job import new_regressor
from simcore.rollout.dataset import VARIABLES, Dataset, gathered
from simcore.scenario.scenario import Scenario


def dataset(*, insertions: int = 2, rows: int = 40, seed: int = 0) -> Dataset:
    """Random rows whose outputs are a bent function of the inputs."""
    rng = np.random.default_rng(seed)
    tables = []
    for _ in range(insertions):
        table = {name: 1e-3 * rng.normal(size=(rows, 3)) for name in VARIABLES}
        table["base_step_m"] = np.tanh(300 * table["tip_error_m"]) * 1e-3 + 0.1 * table["base_position_m"]
        tables.append(table)
    origin = {"commit": "0" * 40, "scenario_template": Scenario().resolved(), "path_box_mm": [[0, 0, 0], [1, 1, 1]]}
    ends = 0.1 * rng.normal(size=(insertions, 3))
    return gathered(tables, ends, samples=10_000, seed=seed, provenance=origin)


def dataset_bytes(**changes: int) -> bytes:
    file = io.BytesIO()
    np.savez_compressed(file, allow_pickle=False, **dataset(**changes).arrays())
    return file.getvalue()


def model_bytes(kind: str, **settings: Any) -> bytes:
    """A model that was trained on `dataset()`."""
    model = train_model(dataset(), new_regressor(kind, settings), split="sample", data_sha256="0" * 64).model
    return model.text().encode()


def npz_member(data: bytes, name: str = "w.npy") -> bytes:
    """A compressed .npz with one member."""
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr(name, data)
    return file.getvalue()


def npz_bomb() -> bytes:
    """A small .npz that unpacks to 300 MB. To make one takes seconds: not while tests are collected."""
    return npz_member(b"\x00" * 300_000_000)
