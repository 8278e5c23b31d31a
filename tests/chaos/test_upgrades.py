"""kill -9 of an upgrade of the database: it is of the one revision or of the next, whole, with all of its jobs.

There is one revision so far: the next one is made up, as in the tests of the database.
"""

from __future__ import annotations

import shutil
import sqlite3
import subprocess
import sys
import time
from contextlib import closing
from typing import TYPE_CHECKING

from service.store.database import MIGRATIONS, open_database, revision_of
from service.store.schema import REVISION
from tests.acceptance.server import ROOT
from tests.chaos.test_server import _check_database

if TYPE_CHECKING:
    import random
    from pathlib import Path

_JOBS = 3000
_NEXT = f"""
from alembic import op
import sqlalchemy as sa
revision, down_revision = "next", "{REVISION}"
def upgrade():
    op.add_column("job", sa.Column("colour", sa.String(8), server_default="red", nullable=False))
    op.execute("UPDATE job SET colour = 'blue' WHERE seq % 2 = 0")
    op.create_index("ix_job_colour", "job", ["colour"])
"""
_UPGRADE = """
import sys
from pathlib import Path
from service.store import database
database.MIGRATIONS, database.REVISION = Path(sys.argv[1]), "next"
print("ready", flush=True)
database.open_database(Path(sys.argv[2])).dispose()
"""


def older_database(path: Path) -> None:
    """With many jobs, so that the upgrade takes a while."""
    open_database(path).dispose()
    fields = "id, name, spec, spec_hash, steps, state, priority, timeout_s, attempt, crashes, cancel_requested, "
    row = f"INSERT INTO job ({fields}created_at, version) VALUES (?, 'a', ?, '0', 1, 'queued', 0, 1, 0, 0, 0, 5, 1)"
    with closing(sqlite3.connect(path)) as connection, connection:
        connection.executemany(row, [(f"job{number}", '{"a": "%s"}' % ("x" * 2000)) for number in range(_JOBS)])


def upgrade(migrations: Path, path: Path) -> subprocess.Popen[str]:
    """The process that upgrades, about to begin."""
    command = [sys.executable, "-c", _UPGRADE, str(migrations), str(path)]
    process = subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    assert process.stdout is not None
    assert process.stdout.readline() == "ready\n"
    return process


def test_upgrades_are_killed(tmp_path: Path, moments: int, chance: random.Random, figures: dict[str, object]) -> None:
    migrations = tmp_path / "migrations"
    shutil.copytree(MIGRATIONS, migrations, ignore=shutil.ignore_patterns("__pycache__"))
    (migrations / "versions" / "0002_next.py").write_text(_NEXT)
    older_database(tmp_path / "older.sqlite")
    longest_s, ends = 0.0, {REVISION: 0, "next": 0}
    for moment in range(moments + 1):  # the first one is left alone
        data = tmp_path / str(moment)
        data.mkdir()
        path = data / "needlebench.sqlite"
        shutil.copy(tmp_path / "older.sqlite", path)
        process, began = upgrade(migrations, path), time.monotonic()
        if moment:
            time.sleep(chance.uniform(0, 1.2 * longest_s))
            process.kill()
        process.communicate()
        longest_s = longest_s or time.monotonic() - began
        _check_database(data)
        found = revision_of(path)
        assert found in ends
        ends[found] += bool(moment)
        again = upgrade(migrations, path)
        _, said = again.communicate()
        assert again.returncode == 0, said
        _check_upgraded(path)
        shutil.rmtree(data)
    figures.update(kills=moments, before=ends[REVISION], after=ends["next"], half=0, jobs_lost=0)


def _check_upgraded(path: Path) -> None:
    """All jobs in the new form; a copy of the old form beside it."""
    assert revision_of(path) == "next"
    with closing(sqlite3.connect(path)) as connection:
        colours = dict(connection.execute("SELECT colour, count(*) FROM job GROUP BY colour"))
    assert colours == {"red": _JOBS // 2, "blue": _JOBS // 2}
    copies = sorted((path.parent / "backups").glob("[!.]*.sqlite"))
    assert copies
    for copy in copies:
        assert revision_of(copy) == REVISION
        with closing(sqlite3.connect(copy)) as connection:
            assert connection.execute("SELECT count(*) FROM job").fetchone() == (_JOBS,)
