"""What a command imports before it answers: the libraries of the simulation are for the workers."""

from __future__ import annotations

import json
import subprocess
import sys

import pytest

SIMULATION = {"scipy", "numba", "rerun", "sklearn", "pandas", "meshio"}
SERVICE = {"fastapi", "uvicorn", "sqlalchemy", "alembic", "pebble"}


def imported(code: str) -> set[str]:
    """Top-level modules that a fresh interpreter has loaded after running `code`."""
    code = f"{code}\nimport json, sys\nprint(json.dumps(sorted(name.partition('.')[0] for name in sys.modules)))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    return set(json.loads(done.stdout.splitlines()[-1]))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("code", "unwanted"),
    [
        ("import service.server.server", SIMULATION | {"alembic"}),
        ("import service.client.client, service.cli.service, service.files.endpoint", SIMULATION | SERVICE),
        ("import service.cli.main", SIMULATION | SERVICE | {"numpy", "pydantic", "httpx", "rich"}),
    ],
    ids=["server", "client", "command"],
)
def test_a_start_waits_for_no_library_that_it_does_not_need(code: str, unwanted: set[str]) -> None:
    assert imported(code) & unwanted == set()


@pytest.mark.slow
def test_a_scenario_without_a_mesh_file_is_checked_without_the_simulation() -> None:
    code = (
        "from service.admission.cost import check_cost\nfrom service.settings import Limits\n"
        "from simcore.scenario.presets import preset\ncheck_cost(preset('demo'), Limits())"
    )
    assert imported(code) & SIMULATION == set()


@pytest.mark.slow
def test_a_ready_database_is_opened_without_alembic() -> None:
    code = (
        "import subprocess, sys, tempfile\nfrom pathlib import Path\nfrom service.store.database import open_database\n"
        "path = Path(tempfile.mkdtemp()) / 'a.sqlite'\n"
        "make = 'import sys; from pathlib import Path; from service.store.database import open_database; '"
        "'open_database(Path(sys.argv[1])).dispose()'\n"
        "subprocess.run([sys.executable, '-c', make, str(path)], check=True)\n"
        "open_database(path).dispose()"
    )
    assert "alembic" not in imported(code)


@pytest.mark.slow
@pytest.mark.parametrize(
    "arguments",
    [
        ["run", "demo", "--out", "nowhere", "--set", "tissue.young_kpa=-1"],
        ["run", "dem", "--out", "nowhere"],
        ["scenario", "dem"],
        ["campaign", "run", "lin10-v1"],
        ["campaign", "run", "--grid", "tissue.young_kpa=3,-3"],
    ],
    ids=lambda arguments: " ".join(arguments),
)
def test_a_refusal_waits_for_no_simulation_and_no_service(arguments: list[str]) -> None:
    code = (
        "from click.testing import CliRunner\nfrom service.cli.main import main\n"
        f"assert CliRunner().invoke(main, {arguments!r}).exit_code == 2"
    )
    unwanted = (SIMULATION | SERVICE | {"pyarrow"}) - {"meshio"}
    assert imported(code) & unwanted == set()
