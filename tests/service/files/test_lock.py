from __future__ import annotations

import os
from pathlib import Path

import pytest

from service.files.lock import LockHeldError, file_lock


def test_a_second_holder_is_refused_and_told_who_holds_it(tmp_path: Path) -> None:
    with (
        file_lock(tmp_path / "lock"),
        pytest.raises(LockHeldError, match=str(os.getpid())),
        file_lock(tmp_path / "lock"),
    ):
        pass


def test_the_lock_is_free_after_use(tmp_path: Path) -> None:
    for _ in range(2):
        with file_lock(tmp_path / "new" / "lock"):
            pass
