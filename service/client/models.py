"""The client's calls about models and controllers."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Self

from service.client.connection import Connection, part

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path


@dataclass(frozen=True, kw_only=True)
class ModelInfo:
    """A model as the service reported it; `raw` is its JSON. Values that its file does not give are None.

    reference: `controller.model` of a scenario that steers by it, with `controller.kind` = kind. source: packaged,
    uploaded or trained. test_rmse_mm: of Delta P along x, y, z. job: id of its training.
    """

    id: str
    reference: str
    source: str
    kind: str
    name: str
    sha256: str
    train_rmse_mm: list[float] | None
    test_rmse_mm: list[float] | None
    data_sha256: str | None
    job: str | None
    raw: Mapping[str, Any] = field(repr=False)

    @classmethod
    def of(cls, raw: Mapping[str, Any]) -> Self:
        """From the JSON of the service."""
        return cls(**{name: raw[name] for name in cls.__dataclass_fields__ if name != "raw"}, raw=raw)


class ModelCalls(Connection):
    """Models and controllers."""

    def models(self) -> list[ModelInfo]:
        """Those that were trained or uploaded, newest first, then the bundled ones."""
        return list(map(ModelInfo.of, self._items("/api/v1/models")))

    def model(self, model_id: str) -> ModelInfo:
        """One model; `raw` has its settings, its provenance and the last jobs that steer by it."""
        return ModelInfo.of(self._json("GET", f"/api/v1/models/{part(model_id)}"))

    def model_file(self, model_id: str, path: Path) -> Path:
        """Download it. Returns `path`."""
        return self._download(f"/api/v1/models/{part(model_id)}/content", path)

    def controllers(self) -> dict[str, str]:
        """Kinds of controllers: kind -> what it does."""
        return {item["kind"]: item["description"] for item in self._json("GET", "/api/v1/controllers")["items"]}
