from __future__ import annotations

import os
import shutil
import sqlite3
from contextlib import closing
from typing import TYPE_CHECKING, Any

import pytest
from alembic import command
from alembic.autogenerate import compare_metadata
from alembic.runtime.migration import MigrationContext
from sqlalchemy import text
from sqlalchemy.exc import IntegrityError

from service.store import database
from service.store.database import ForeignDatabaseError, open_database, revision_of, revisions
from service.store.jobs import Store
from service.store.schema import REVISION, metadata

if TYPE_CHECKING:
    from pathlib import Path


def test_the_migrations_make_exactly_the_tables(tmp_path: Path) -> None:
    engine = open_database(tmp_path / "a.sqlite")
    with engine.begin() as connection:
        assert compare_metadata(MigrationContext.configure(connection), metadata) == []
    engine.dispose()


def test_the_tables_are_at_the_newest_revision() -> None:
    assert revisions()[0] == REVISION


def test_opening_twice_changes_nothing(tmp_path: Path) -> None:
    for _ in range(2):
        open_database(tmp_path / "a.sqlite").dispose()


@pytest.mark.slow
@pytest.mark.parametrize("revision", ["0005", "9999"])
def test_a_database_of_another_version_is_refused_and_left_alone(tmp_path: Path, revision: str) -> None:
    path = tmp_path / "a.sqlite"
    engine = open_database(path)
    with engine.begin() as connection:
        connection.execute(text("UPDATE alembic_version SET version_num = :revision"), {"revision": revision})
    engine.dispose()
    before = path.read_bytes()
    with pytest.raises(ForeignDatabaseError, match=rf"revision {revision}, this version uses {REVISION}\).*--data"):
        open_database(path)
    assert path.read_bytes() == before
    assert not (tmp_path / "backups").exists()


def test_a_file_with_tables_of_another_program_is_refused_and_left_alone(tmp_path: Path) -> None:
    path = tmp_path / "a.sqlite"
    with closing(sqlite3.connect(path)) as connection:
        connection.execute("CREATE TABLE job (id TEXT)")
    before = path.read_bytes()
    with pytest.raises(ForeignDatabaseError, match=r"not needlebench's.*--data"):
        open_database(path)
    assert path.read_bytes() == before


# -- the next revision, whatever it will be


@pytest.fixture
def next_revision(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A database at the newest revision, and migrations that hold one more."""
    path = tmp_path / "a.sqlite"
    open_database(path).dispose()
    with closing(sqlite3.connect(path)) as connection, connection:
        connection.execute(
            "INSERT INTO job (id, name, spec, spec_hash, steps, state, priority, timeout_s, attempt, crashes, "
            "cancel_requested, created_at, version) VALUES ('old', 'a', '{}', '0', 1, 'queued', 0, 1, 0, 0, 0, 5, 1)"
        )
    migrations = tmp_path / "migrations"
    shutil.copytree(database.MIGRATIONS, migrations, ignore=shutil.ignore_patterns("__pycache__"))
    (migrations / "versions" / "0002_next.py").write_text(NEXT)
    monkeypatch.setattr(database, "MIGRATIONS", migrations)
    monkeypatch.setattr(database, "REVISION", "next")
    return path


NEXT = """
from alembic import op
import sqlalchemy as sa
revision, down_revision = "next", "job_notes"
def upgrade():
    op.add_column("job", sa.Column("colour", sa.String(8), server_default="red", nullable=False))
"""


@pytest.mark.slow
def test_an_older_database_is_copied_then_upgraded_with_its_jobs(
    next_revision: Path, caplog: pytest.LogCaptureFixture
) -> None:
    path, backups = next_revision, next_revision.parent / "backups"
    store = Store(open_database(path, now=lambda: 0.0))
    assert store.get("old").created_at == 5.0
    store.close()
    with closing(sqlite3.connect(path)) as connection:
        assert connection.execute("SELECT id, colour FROM job").fetchall() == [("old", "red")]
    assert revision_of(path) == revisions()[0] == "next"
    (copy,) = backups.iterdir()
    assert copy.name == "a-job_notes-19700101T000000Z.sqlite"
    assert revision_of(copy) == "job_notes"
    with closing(sqlite3.connect(copy)) as connection:
        assert connection.execute("SELECT id FROM job").fetchall() == [("old",)]
    assert copy.name in caplog.text
    open_database(path).dispose()
    assert len(list(backups.iterdir())) == 1


@pytest.mark.slow
def test_an_upgrade_that_fails_leaves_the_database_as_it_was(
    next_revision: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = next_revision
    before = statements(path)

    def half(config: Any, _target: str) -> None:
        config.attributes["connection"].exec_driver_sql("DROP TABLE idempotency")
        raise OSError(28, os.strerror(28))

    monkeypatch.setattr(command, "upgrade", half)
    with pytest.raises(OSError, match="No space left"):
        open_database(path)
    assert statements(path) == before
    assert revision_of(path) == "job_notes"


def statements(path: Path) -> list[tuple[str]]:
    with closing(sqlite3.connect(path)) as connection:
        return connection.execute("SELECT sql FROM sqlite_master ORDER BY name").fetchall()


def test_the_database_is_in_wal_mode_and_checks_foreign_keys(tmp_path: Path) -> None:
    engine = open_database(tmp_path / "with %20 strange name.sqlite")
    with engine.begin() as connection:
        assert connection.execute(text("PRAGMA journal_mode")).scalar() == "wal"
        assert connection.execute(text("PRAGMA foreign_keys")).scalar() == 1
    engine.dispose()


def test_events_are_append_only(tmp_path: Path) -> None:
    engine = open_database(tmp_path / "a.sqlite")
    with engine.begin() as connection:
        connection.execute(text("INSERT INTO event (job_id, at, kind, attempt) VALUES ('a', 0, 'b', 0)"))
    with pytest.raises(IntegrityError, match="append-only"), engine.begin() as connection:
        connection.execute(text("UPDATE event SET kind = 'c'"))
    engine.dispose()
