"""A service whose end tells how many objects the interpreter's last collection passes over."""

from __future__ import annotations

import atexit
import gc
import sys
from pathlib import Path

from tests.acceptance import server


def main() -> None:
    """As `tests.acceptance.server.main`."""
    atexit.register(lambda: (Path(sys.argv[1]) / "frozen").write_text(str(gc.get_freeze_count())))
    server.main()
