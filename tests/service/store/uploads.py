"""Files to upload, and how they are sent."""

from __future__ import annotations

import io
from typing import TYPE_CHECKING, Any

import numpy as np

from tests.simcore.mesh.test_mesh_file import write_box

if TYPE_CHECKING:
    from pathlib import Path

    from starlette.testclient import TestClient


UPLOADS = "/api/v1/uploads"
JOBS = "/api/v1/jobs"


def box(folder: Path) -> bytes:
    path, _ = write_box(folder, "box.vtk")
    return path.read_bytes()


def arrays(**values: Any) -> bytes:
    file = io.BytesIO()
    np.savez(file, **values)
    return file.getvalue()


def send(http: TestClient, data: bytes, name: str = "box.vtk", kind: str = "mesh", **headers: str) -> Any:
    return http.post(UPLOADS, params={"kind": kind, "name": name}, content=data, headers=headers)


def scenario(reference: str) -> dict[str, Any]:
    return {
        "tissue": {"mesh_file": reference, "fixed_faces": ["y_min", "y_max"]},
        "interaction": {"spacing_mm": 11},
        "trajectory": {"entry_mm": [10, 20, 0], "target_mm": [10, 20, 30]},
        "needle": {"length_mm": 100},
    }
