"""One short run, which no test changes."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from simcore.rollout.rollout import run
from tests.simcore.short_run import short

if TYPE_CHECKING:
    from simcore.rollout.result import Rollout


@pytest.fixture(scope="module")
def plain() -> Rollout:
    return run(short())
