"""How thoroughly the property tests look: briefly in `make test`, ten times as long in `make test-long`."""

from __future__ import annotations

import os

LONG = os.environ.get("NEEDLEBENCH_TESTS") == "long"


def examples(usual: int) -> int:
    """How many examples hypothesis draws: the usual number, or ten times as many in the long tier."""
    return 10 * usual if LONG else usual
