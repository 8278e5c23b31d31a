from __future__ import annotations

from pathlib import Path

import pytest
from alembic.autogenerate import compare_metadata
from alembic.runtime.migration import MigrationContext
from sqlalchemy import text
from sqlalchemy.exc import IntegrityError

import service.store.access_tables
import service.store.campaign_tables  # noqa: F401  (belong to the tables)
from service.store.database import DatabaseTooNew, open_database
from service.store.tables import metadata


def test_the_migrations_make_exactly_the_tables(tmp_path: Path) -> None:
    engine = open_database(tmp_path / "a.sqlite")
    with engine.begin() as connection:
        assert compare_metadata(MigrationContext.configure(connection), metadata) == []
    engine.dispose()


def test_opening_twice_changes_nothing(tmp_path: Path) -> None:
    for _ in range(2):
        open_database(tmp_path / "a.sqlite").dispose()


def test_a_newer_database_is_refused_and_left_alone(tmp_path: Path) -> None:
    path = tmp_path / "a.sqlite"
    engine = open_database(path)
    with engine.begin() as connection:
        connection.execute(text("UPDATE alembic_version SET version_num = '9999'"))
    engine.dispose()
    with pytest.raises(DatabaseTooNew, match=r"9999.*--data"):
        open_database(path)


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
