"""Two insertions, run once for each module that looks at them."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from service.local import bundle_runs
from tests.service.local.bundled import runs_in

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path


@pytest.fixture(scope="module", autouse=True)
def _no_clock() -> Iterator[None]:
    """L0 is not measured: its kernels would have to be compiled."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(bundle_runs, "_l0_ms", lambda _: 0.5)
        yield


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return runs_in(tmp_path_factory.mktemp("runs"), {"kind": "ifem"}, {"kind": "open_loop"})
