"""The trip along a curve that several physics tests look at."""

from __future__ import annotations

import pytest

from tests.simcore.block import Trip, curved_trip


@pytest.fixture(scope="session")
def curved() -> Trip:
    return curved_trip()
