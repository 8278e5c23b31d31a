"""One environment on a coarse mesh."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from needlebench.gym import NeedleEnv
from tests.gym.coarse import COARSE

if TYPE_CHECKING:
    from collections.abc import Iterator


@pytest.fixture
def env() -> Iterator[NeedleEnv]:
    made = NeedleEnv(changes=COARSE, render_mode="rgb_array")
    yield made
    made.close()
