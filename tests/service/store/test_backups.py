"""Damaged and cut databases are refused with the way out; a backup is whole or not there, and leads back."""

from __future__ import annotations

import json
import os
import shutil
import signal
import sqlite3
import subprocess
import sys
import time
from contextlib import closing
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest
from sqlalchemy import insert

from service.store import backups
from service.store.backup_names import BACKUPS, CONTENTS, newest_backup
from service.store.backups import BackupError, daily_backup, read_backup, restore_backup, take_backup
from service.store.database import open_database
from service.store.integrity import DamagedDatabaseError, accept_as_it_is, acknowledged, check_whole
from service.store.jobs import Store
from service.store.schema import artefact
from tests.service.databases import lay_down

if TYPE_CHECKING:
    from collections.abc import Iterator

DATABASE = "needlebench.sqlite"
DAY_S = 86_400.0


@pytest.fixture
def data(tmp_path: Path) -> Path:
    return lay_down(tmp_path / "data" / DATABASE).parent


@pytest.fixture
def store(data: Path) -> Iterator[Store]:
    made = Store(open_database(data / DATABASE))
    yield made
    made.close()


def submit(store: Store, count: int) -> list[str]:
    spec: dict[str, Any] = {"scenario": {}}
    given: dict[str, Any] = {"spec": spec, "spec_hash": "0", "steps": 10, "priority": 0, "timeout_s": 60.0}
    return [store.submit(name=f"s{number}", **given).id for number in range(count)]


def with_file(store: Store, data: Path, job_id: str, content: bytes = b"a result") -> Path:
    path = data / "jobs" / job_id / "1" / "result.json"
    path.parent.mkdir(parents=True)
    path.write_bytes(content)
    row = {"job_id": job_id, "kind": "result", "name": path.name, "sha256": "0" * 64, "bytes": len(content)}
    with store.writing() as connection:
        connection.execute(insert(artefact).values(path=path.relative_to(data).as_posix(), **row))
    return path


def as_killed(store: Store, data: Path, target: Path) -> Path:
    """What the folder holds if the process is killed now."""
    shutil.copytree(data, target)
    assert (target / f"{DATABASE}-wal").stat().st_size > 0, store
    return target


def jobs_in(data: Path) -> int:
    with closing(sqlite3.connect(data / DATABASE)) as connection:
        return int(connection.execute("SELECT count(*) FROM job").fetchone()[0])


# -- the check at the start


@pytest.mark.slow
def test_a_killed_server_leaves_nothing_to_complain_of(store: Store, data: Path, tmp_path: Path) -> None:
    submit(store, 22)
    killed = as_killed(store, data, tmp_path / "killed")
    open_database(killed / DATABASE).dispose()
    assert jobs_in(killed) == 22


@pytest.mark.slow
@pytest.mark.parametrize("share", [0.0, 0.2, 0.5, 0.95])
def test_a_log_that_was_cut_is_refused_with_the_ways_on(store: Store, data: Path, tmp_path: Path, share: float) -> None:
    submit(store, 22)
    killed = as_killed(store, data, tmp_path / "killed")
    log = killed / f"{DATABASE}-wal"
    os.truncate(log, int(share * log.stat().st_size))
    before = (killed / DATABASE).read_bytes()
    with pytest.raises(DamagedDatabaseError, match=r"has lost \d+ of 44 rows.*no backup.*restore --as-it-is --data"):
        open_database(killed / DATABASE)
    assert (killed / DATABASE).read_bytes() == before
    accept_as_it_is(killed / DATABASE)
    open_database(killed / DATABASE).dispose()


def test_a_log_that_was_removed_is_refused(store: Store, data: Path, tmp_path: Path) -> None:
    submit(store, 3)
    killed = as_killed(store, data, tmp_path / "killed")
    (killed / f"{DATABASE}-wal").unlink()
    with pytest.raises(DamagedDatabaseError, match="has lost 6 of 6 rows"):
        open_database(killed / DATABASE)


@pytest.mark.slow
@pytest.mark.parametrize("damage", ["zeros inside", "cut in half", "another file", "empty pages"])
def test_a_damaged_file_is_refused_with_the_newest_backup(store: Store, data: Path, damage: str) -> None:
    submit(store, 200)
    copy = take_backup(data, data / BACKUPS / "manual", with_files=False, now=1e9)
    store.close()
    path = data / DATABASE
    content = bytearray(path.read_bytes())
    if damage == "zeros inside":
        content[20 * 4096 : 60 * 4096] = bytes(40 * 4096)
    elif damage == "empty pages":
        content[4096:] = b"\xff" * (len(content) - 4096)
    elif damage == "cut in half":
        del content[len(content) // 2 :]
    path.write_bytes(b"hello" * 1000 if damage == "another file" else content)
    before = path.read_bytes()
    with pytest.raises(DamagedDatabaseError, match=rf"is damaged.*needlebench restore {copy.folder} --data {data}"):
        open_database(path)
    assert path.read_bytes() == before
    kept, _ = restore_backup(read_backup(copy.folder), data, now=2e9)
    assert kept is not None
    assert (kept / DATABASE).read_bytes() == before
    check_whole(path)
    assert jobs_in(data) == 200


def test_ends_of_jobs_count_once_they_are_published(store: Store, data: Path) -> None:
    from service.store.job import FINISHED, Outcome

    submit(store, 2)
    job = store.claim()
    assert job is not None
    before = acknowledged(data / DATABASE)
    done, _ = store.exchange(job, Outcome(state=FINISHED, result={}))
    assert acknowledged(data / DATABASE) == before
    store.publish(done.id)
    assert acknowledged(data / DATABASE) == before + 3  # one begun, ended, the next begun


# -- backup and restore


def test_a_backup_while_others_write_is_whole_and_leads_back(store: Store, data: Path, tmp_path: Path) -> None:
    [job_id] = submit(store, 1)
    file = with_file(store, data, job_id)
    made = take_backup(data, tmp_path / "kept", with_files=True, now=1e9)
    submit(store, 3)
    store.close()
    file.unlink()
    kept, missing = restore_backup(read_backup(tmp_path / "kept"), data, now=2e9)
    assert (jobs_in(data), missing, file.read_bytes()) == (1, [], b"a result")
    assert made.files == {f"jobs/{job_id}/1/result.json": 8}
    assert kept == data / BACKUPS / "replaced-20330518T033320Z"
    assert jobs_in(kept) == 4
    open_database(data / DATABASE).dispose()


def test_a_backup_of_the_database_alone_says_which_files_are_missing(store: Store, data: Path, tmp_path: Path) -> None:
    [job_id] = submit(store, 1)
    file = with_file(store, data, job_id)
    take_backup(data, tmp_path / "kept", with_files=False, now=1e9)
    store.close()
    file.unlink()
    assert restore_backup(read_backup(tmp_path / "kept"), data, now=2e9)[1] == [f"jobs/{job_id}/1/result.json"]


def test_a_file_of_the_wrong_size_is_left_out_and_named(store: Store, data: Path, tmp_path: Path) -> None:
    [job_id] = submit(store, 1)
    with_file(store, data, job_id).write_bytes(b"cut")
    made = take_backup(data, tmp_path / "kept", with_files=True, now=1e9)
    assert made.left_out == (f"jobs/{job_id}/1/result.json",)
    assert read_backup(tmp_path / "kept").files == {}


def test_a_job_that_is_removed_meanwhile_is_in_no_backup(
    store: Store, data: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    [job_id] = submit(store, 1)
    with_file(store, data, job_id)
    store.cancel(job_id)
    copy = backups._copy

    def remove_first(source: Path, target: Path) -> None:
        if (data / "jobs").exists():
            store.delete(job_id)
            shutil.rmtree(data / "jobs")
        copy(source, target)

    monkeypatch.setattr(backups, "_copy", remove_first)
    assert take_backup(data, tmp_path / "kept", with_files=True, now=1e9).files == {}
    assert jobs_in(tmp_path / "kept") == 0


def test_what_is_no_whole_backup_is_refused(store: Store, data: Path, tmp_path: Path) -> None:
    [job_id] = submit(store, 1)
    with_file(store, data, job_id)
    made = take_backup(data, tmp_path / "kept", with_files=True, now=1e9)
    with pytest.raises(BackupError, match="is there already"):
        take_backup(data, tmp_path / "kept", with_files=True, now=1e9)
    with pytest.raises(BackupError, match="no database"):
        take_backup(tmp_path / "none", tmp_path / "other", with_files=True, now=1e9)
    (made.folder / "jobs" / job_id / "1" / "result.json").write_bytes(b"")
    with pytest.raises(BackupError, match="1 files are missing or cut"):
        read_backup(made.folder)
    contents = json.loads((made.folder / CONTENTS).read_text())
    (made.folder / CONTENTS).write_text(json.dumps({**contents, "files": {"../../etc/passwd": 3}}))
    with pytest.raises(BackupError, match="outside of a data folder"):
        read_backup(made.folder)
    with pytest.raises(BackupError, match="is no backup"):
        read_backup(tmp_path)


def test_a_restore_that_was_killed_is_refused_until_it_is_done_again(
    store: Store, data: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    submit(store, 2)
    take_backup(data, data / BACKUPS / "manual", with_files=False, now=1e9)
    submit(store, 2)
    killed = as_killed(store, data, tmp_path / "killed")
    backup = read_backup(killed / BACKUPS / "manual")
    monkeypatch.setattr(backups, "accept_as_it_is", lambda _path: (_ for _ in ()).throw(KeyboardInterrupt))
    with pytest.raises(KeyboardInterrupt):
        restore_backup(backup, killed, now=2e9)
    monkeypatch.undo()
    with pytest.raises(DamagedDatabaseError, match="interrupted"):
        open_database(killed / DATABASE)
    restore_backup(backup, killed, now=2e9 + 1)
    open_database(killed / DATABASE).dispose()
    assert jobs_in(killed) == 2


@pytest.mark.slow
def test_there_is_one_backup_a_day_and_the_oldest_go(store: Store, data: Path) -> None:
    submit(store, 1)
    made = [daily_backup(data, 3, now=1e9 + hours * 3600.0) for hours in range(0, 24 * 6, 12)]
    assert [path is not None for path in made] == [True, False] * 6
    present = sorted(path.name for path in (data / BACKUPS).iterdir())
    assert present == [path.name for path in made[::2] if path is not None][-3:]
    assert newest_backup(data / BACKUPS) is not None
    assert daily_backup(data, 3, now=1e9) is not None  # a clock that was set back: the one of the future does not count


_COPY = """
import sys, time
from pathlib import Path
from service.store import backups
copy = backups._copy
backups._copy = lambda source, target: (time.sleep(0.02), copy(source, target))
print("begins", flush=True)
backups.take_backup(Path(sys.argv[1]), Path(sys.argv[2]), with_files=True, now=1e9)
"""


@pytest.mark.slow
def test_a_backup_that_is_killed_leaves_no_backup_and_a_sound_store(store: Store, data: Path, tmp_path: Path) -> None:
    for job_id in submit(store, 60):
        with_file(store, data, job_id)
    home = {**os.environ, "PYTHONPATH": str(Path(__file__).parents[3])}
    target = tmp_path / "kept"
    for wait_s in (0.0, 0.1, 0.5):
        command = [sys.executable, "-c", _COPY, str(data), str(target)]
        process = subprocess.Popen(command, env=home, stdout=subprocess.PIPE, text=True)
        assert process.stdout is not None
        assert process.stdout.readline() == "begins\n"
        time.sleep(wait_s)
        process.send_signal(signal.SIGKILL)
        process.communicate()
        assert not target.exists()
        submit(store, 1)
    take_backup(data, target, with_files=True, now=1e9)
    assert len(read_backup(target).files) == 60
    assert [path.name for path in tmp_path.iterdir() if path.name.endswith(".part")] == []
    store.close()
    check_whole(data / DATABASE)
    assert jobs_in(data) == 63


def test_the_commands_back_up_and_restore(store: Store, data: Path, tmp_path: Path) -> None:
    from click.testing import CliRunner

    from service.cli.main import main

    def invoke(*args: str) -> Any:
        return CliRunner().invoke(main, [*args, "--data", str(data)])

    submit(store, 2)
    done = invoke("backup", str(tmp_path / "kept"))
    assert (done.exit_code, done.stdout) == (0, f"{tmp_path / 'kept'}\n"), done.output
    assert invoke("backup", str(tmp_path / "kept")).exit_code == 1
    submit(store, 2)
    store.close()
    assert invoke("restore").exit_code == 2
    done = invoke("restore", str(tmp_path / "kept"))
    assert done.exit_code == 0, done.output
    assert "restored the state of" in done.stderr
    assert jobs_in(data) == 2
    for path in (tmp_path / "kept", tmp_path / "kept" / DATABASE, data / DATABASE):
        assert path.stat().st_mode & 0o077 == 0, path
    assert "is no backup" in invoke("restore", str(tmp_path)).stderr
    assert invoke("restore", "--as-it-is").exit_code == 0
