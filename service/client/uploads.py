"""The client's calls about uploads."""

from __future__ import annotations

from typing import TYPE_CHECKING

from service.client.connection import Connection, part
from service.client.records import UploadedFile

if TYPE_CHECKING:
    from pathlib import Path


class UploadCalls(Connection):
    """Meshes, models, data sets and poses."""

    def upload(self, path: Path, *, kind: str | None = None) -> UploadedFile:
        """Upload a tissue mesh, a model, a data set or poses; kind: mesh, model, dataset or poses, by default from the
        suffix.

        The same content is the same upload. A scenario or a training refers to it by its `reference`.
        """
        kind = kind or {".json": "model", ".npz": "dataset", ".npy": "poses"}.get(path.suffix.lower(), "mesh")
        with path.open("rb") as file:
            headers = {"Content-Type": "application/octet-stream"}
            params = {"kind": kind, "name": path.name}
            raw = self._json("POST", "/api/v1/uploads", params=params, content=file, headers=headers, timeout=300.0)
        return UploadedFile.of(raw)

    def upload_file(self, upload_id: str, path: Path) -> Path:
        """Download an upload. Returns `path`."""
        return self._download(f"/api/v1/uploads/{part(upload_id)}/content", path)

    def pin_upload(self, upload_id: str) -> UploadedFile:
        """Keep it when old uploads are removed."""
        return UploadedFile.of(self._json("POST", f"/api/v1/uploads/{part(upload_id)}/pin"))

    def unpin_upload(self, upload_id: str) -> None:
        """Allow it to be removed again."""
        self._request("DELETE", f"/api/v1/uploads/{part(upload_id)}/pin")

    def uploads(self) -> list[UploadedFile]:
        """All uploads, newest first."""
        return list(map(UploadedFile.of, self._items("/api/v1/uploads")))

    def delete_upload(self, upload_id: str) -> None:
        """Delete an upload that is not pinned and that no queued or running job uses."""
        self._request("DELETE", f"/api/v1/uploads/{part(upload_id)}")
