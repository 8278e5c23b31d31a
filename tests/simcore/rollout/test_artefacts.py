"""Files that are complete or not there at all."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import zipfile
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
import pytest

from simcore import provenance
from simcore.rollout import artefacts
from simcore.rollout.artefacts import RESULT, SERIES, replace_atomically, write


class FakeRollout:
    """What `write` needs of a rollout."""

    def __init__(self, value: float = 1.0) -> None:
        self.value = value
        self.series: dict[str, Any] = {
            "t_s": np.arange(3) * value,
            "limited": np.zeros(3, bool),
            "empty": np.zeros((0, 3)),
        }

    def result(self) -> dict[str, Any]:
        return {"status": "completed", "metrics": {"rmse_commanded_mm": self.value, "lambda_ratio": None}}


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def test_write_makes_the_folder_and_both_files(tmp_path: Path) -> None:
    folder = tmp_path / "a" / "b"
    paths = write(FakeRollout(), folder)  # type: ignore[arg-type]
    assert paths == [folder / RESULT, folder / SERIES]
    assert names(folder) == [RESULT, SERIES]
    assert json.loads((folder / RESULT).read_text())["metrics"] == {"rmse_commanded_mm": 1.0, "lambda_ratio": None}
    assert (folder / RESULT).read_bytes().endswith(b"}\n")


def test_series_load_without_pickle(tmp_path: Path) -> None:
    rollout = FakeRollout()
    write(rollout, tmp_path)  # type: ignore[arg-type]
    with np.load(tmp_path / SERIES, allow_pickle=False) as found:
        assert set(found) == set(rollout.series)
        for name, array in rollout.series.items():
            np.testing.assert_array_equal(found[name], array)
            assert found[name].dtype == array.dtype
    with zipfile.ZipFile(tmp_path / SERIES) as archive:
        assert archive.testzip() is None


def test_an_object_array_is_refused_and_leaves_nothing(tmp_path: Path) -> None:
    rollout = FakeRollout()
    rollout.series["bad"] = np.array([{}, None], dtype=object)
    with pytest.raises(ValueError, match="allow_pickle"):
        write(rollout, tmp_path)  # type: ignore[arg-type]
    assert names(tmp_path) == []


def test_a_result_that_is_not_strict_json_is_refused_before_anything_is_written(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="JSON compliant"):
        write(FakeRollout(float("nan")), tmp_path / "new")  # type: ignore[arg-type]
    assert not (tmp_path / "new").exists()


def test_a_second_write_replaces_both(tmp_path: Path) -> None:
    for value in (1.0, 2.0):
        write(FakeRollout(value), tmp_path)  # type: ignore[arg-type]
    assert json.loads((tmp_path / RESULT).read_text())["metrics"]["rmse_commanded_mm"] == 2.0
    with np.load(tmp_path / SERIES) as found:
        assert found["t_s"][1] == 2.0
    assert names(tmp_path) == [RESULT, SERIES]


def test_an_old_result_never_stands_beside_a_new_series(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write(FakeRollout(1.0), tmp_path)  # type: ignore[arg-type]
    original = replace_atomically

    def fails_on_result(path: Path, fill: Any) -> None:
        if path.name == RESULT:
            raise KeyboardInterrupt
        original(path, fill)

    monkeypatch.setattr(artefacts, "replace_atomically", fails_on_result)
    with pytest.raises(KeyboardInterrupt):
        write(FakeRollout(2.0), tmp_path)  # type: ignore[arg-type]
    assert names(tmp_path) == [SERIES]


# ---- one file


@pytest.mark.parametrize("error", [RuntimeError, OSError, KeyboardInterrupt, SystemExit])
@pytest.mark.parametrize("before", [None, b"old"])
def test_a_fill_that_fails_in_the_middle_leaves_the_old_file(
    tmp_path: Path, error: type[BaseException], before: bytes | None
) -> None:
    path = tmp_path / "file"
    if before is not None:
        path.write_bytes(before)

    def fill(file: BinaryIO) -> None:
        file.write(b"half")
        file.flush()
        raise error("stopped")

    with pytest.raises(error):
        replace_atomically(path, fill)
    assert names(tmp_path) == ([] if before is None else ["file"])
    assert before is None or path.read_bytes() == before


def test_the_old_file_is_there_until_the_new_one_is_complete(tmp_path: Path) -> None:
    path = tmp_path / "file"
    path.write_bytes(b"old")

    def fill(file: BinaryIO) -> None:
        file.write(b"new" * 100_000)
        file.flush()
        assert path.read_bytes() == b"old"

    replace_atomically(path, fill)
    assert path.read_bytes() == b"new" * 100_000
    assert names(tmp_path) == ["file"]


def test_a_full_disk_is_noticed_before_the_rename(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(_: int) -> None:
        raise OSError(28, "No space left on device")

    path = tmp_path / "file"
    path.write_bytes(b"old")
    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(OSError, match="No space"):
        replace_atomically(path, lambda file: file.write(b"new"))
    assert path.read_bytes() == b"old"
    assert names(tmp_path) == ["file"]


@pytest.mark.skipif(os.name == "nt", reason="no SIGKILL")
def test_a_kill_in_the_middle_leaves_the_old_file(tmp_path: Path) -> None:
    path = tmp_path / "result.json"
    path.write_bytes(b"old")
    program = (
        "import os, signal, sys; from pathlib import Path; from simcore.rollout.artefacts import replace_atomically\n"
        "def fill(file):\n    file.write(b'half'); file.flush(); os.kill(os.getpid(), signal.SIGKILL)\n"
        "replace_atomically(Path(sys.argv[1]), fill)"
    )
    done = subprocess.run(
        [sys.executable, "-c", program, str(path)], cwd=Path(__file__).resolve().parents[3], check=False
    )
    assert done.returncode == -signal.SIGKILL
    assert path.read_bytes() == b"old"
    assert [name for name in names(tmp_path) if not name.startswith(".")] == ["result.json"]


# ---- provenance


def test_provenance_names_what_a_rerun_needs() -> None:
    found = provenance.provenance({"seed": 7})
    assert found["scenario"] == {"seed": 7}
    assert found["seed"] == 7
    assert found["threads"] == 1
    assert {"python", "numpy", "scipy", "numba", "llvmlite"} <= found["versions"].keys()
    assert found["cpu"]
    assert found["platform"]
    assert json.loads(json.dumps(found, allow_nan=False)) == found


def test_provenance_hands_out_copies() -> None:
    provenance.provenance({"seed": 1})["versions"].clear()
    assert provenance.provenance({"seed": 1})["versions"]


@pytest.fixture
def fresh_commit(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A package folder of its own, and no remembered commit."""
    root = tmp_path / "simcore"
    root.mkdir()
    monkeypatch.setattr(provenance, "_ROOT", root)
    monkeypatch.setattr(provenance, "commit", provenance.commit.__wrapped__)
    monkeypatch.delenv("NEEDLEBENCH_COMMIT", raising=False)
    return root


def test_the_commit_of_a_wheel_is_the_recorded_one(fresh_commit: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("NEEDLEBENCH_COMMIT", "other")
    (fresh_commit / "_commit.txt").write_text("abc123\n")
    assert provenance.commit() == "abc123"
    (fresh_commit / "_commit.txt").write_text("\n")
    assert provenance.commit() is None


def test_the_commit_without_git_comes_from_the_environment(fresh_commit: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert provenance.commit() is None
    monkeypatch.setenv("NEEDLEBENCH_COMMIT", "abc123")
    assert provenance.commit() == "abc123"
    (fresh_commit.parent / ".git").mkdir()  # not a repository: git fails
    assert provenance.commit() == "abc123"


def test_the_commit_of_a_checkout_says_when_it_was_changed(fresh_commit: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("GIT_DIR", "GIT_WORK_TREE", "GIT_INDEX_FILE"):
        monkeypatch.delenv(name, raising=False)
    source = fresh_commit / "file.py"
    source.write_text("one")
    identity = ["-c", "user.name=a", "-c", "user.email=a@example.org"]
    for words in (["init", "-q"], ["add", "."], [*identity, "commit", "-qm", "first"]):
        subprocess.run(["git", *words], cwd=fresh_commit.parent, check=True)
    clean = provenance.commit()
    assert clean is not None
    assert len(clean) == 40
    (fresh_commit / "untracked").write_text("x")
    assert provenance.commit() == clean
    source.write_text("two")
    assert provenance.commit() == f"{clean}-dirty"
