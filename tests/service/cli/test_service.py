from __future__ import annotations

import re
from typing import TYPE_CHECKING

import click
import pytest
from click.testing import CliRunner, Result

from service.api_key import id_of
from service.cli.main import main

if TYPE_CHECKING:
    from pathlib import Path


def needlebench(*words: str, **variables: str) -> Result:
    names = ("NEEDLEBENCH_API_KEY", "NEEDLEBENCH_HOST", "NEEDLEBENCH_PORT", "NEEDLEBENCH_WORKERS", "NEEDLEBENCH_URL")
    return CliRunner().invoke(main, words, env={**dict.fromkeys(names), **variables})


def commands(group: click.Group, *names: str) -> list[tuple[str, ...]]:
    """The words that lead to each command, groups included."""
    found: list[tuple[str, ...]] = []
    for name in group.list_commands(click.Context(group)):
        command = group.get_command(click.Context(group), name)
        found.append((*names, name))
        found += commands(command, *names, name) if isinstance(command, click.Group) else []
    return found


@pytest.mark.parametrize("words", commands(main), ids=" ".join)
def test_help_teaches_by_example(words: tuple[str, ...]) -> None:
    told = needlebench(*words, "--help")
    assert told.exit_code == 0
    assert len(re.findall(r": +(NEEDLEBENCH_\w+=\S+ )?needlebench ", told.output)) >= 1


@pytest.mark.parametrize("host", ["0.0.0.0", "192.168.1.5"])
def test_an_open_address_is_refused_without_a_key_with_the_line_to_type(tmp_path: Path, host: str) -> None:
    refused = needlebench("serve", "--host", host, "--port", "9000", "--data", str(tmp_path / "data"))
    assert refused.exit_code == 2
    assert re.search(rf"NEEDLEBENCH_API_KEY=\S{{20,}} needlebench serve --host {host} --port 9000\n", refused.output)
    assert not (tmp_path / "data").exists()


def test_a_wrong_setting_is_named_and_nothing_is_made(tmp_path: Path) -> None:
    refused = needlebench("serve", "--data", str(tmp_path / "data"), NEEDLEBENCH_WORKERS="3")
    assert refused.exit_code == 2
    assert "NEEDLEBENCH_WORKERS = 3: must be 1 to 2" in refused.output
    assert not (tmp_path / "data").exists()


def test_without_a_service_the_way_to_start_one_is_told(tmp_path: Path) -> None:
    told = needlebench("jobs", NEEDLEBENCH_DATA=str(tmp_path), NEEDLEBENCH_URL="http://127.0.0.1:9")
    assert told.exit_code == 1
    assert "needlebench serve" in told.output


def test_listing_keys_makes_no_data_folder(tmp_path: Path) -> None:
    for words in (["key", "list"], ["key", "revoke", "ab"]):
        done = needlebench(*words, "--data", str(tmp_path / "nothing"))
        assert done.exit_code == 2
        assert "is not a service's data folder" in done.stderr
    assert not (tmp_path / "nothing").exists()


def test_a_table_that_cannot_be_written_is_refused_before_anything_runs(tmp_path: Path) -> None:
    wanted = str(tmp_path / "nothing" / "a.csv")
    data = tmp_path / "data"
    done = needlebench("campaign", "run", "--grid", "seed=1", "--csv", wanted, "--data", str(data))
    assert (done.exit_code, data.exists()) == (2, False)
    assert "--csv = " in done.stderr
    assert ": there is no folder " in done.stderr


@pytest.mark.slow
def test_keys_are_made_listed_and_revoked_in_the_data_folder(tmp_path: Path) -> None:
    data = ("--data", str(tmp_path))
    made = needlebench("key", "create", "--scope", "admin", "--note", "me", *data)
    assert made.exit_code == 0, made.output
    text = made.stdout.strip()
    key_id = id_of(text)
    assert key_id is not None
    assert "is not shown again" in made.stderr
    assert "from now on" in made.stderr
    listed = needlebench("key", "list", *data).stdout
    assert re.match(rf"{key_id}  admin +created \d{{4}}-.* used never +me\n", listed)
    assert text not in listed
    revoked = needlebench("key", "revoke", key_id, *data)
    assert (revoked.exit_code, "no key is left" in revoked.stderr) == (0, True)
    assert "revoked 2" in needlebench("key", "list", *data).stdout
    assert needlebench("key", "revoke", "unknown", *data).exit_code == 1
    assert needlebench("key", "create", "--note", "x" * 300, *data).exit_code == 2


@pytest.mark.slow
def test_a_warning_says_when_no_key_allows_submitting(tmp_path: Path) -> None:
    data = ("--data", str(tmp_path))
    told = [
        needlebench("key", "create", "--scope", scope, *data).stderr for scope in ("read", "read", "submit", "read")
    ]
    assert ["no key allows submitting" in text for text in told] == [True, True, False, False]
    assert ["this is the first key" in text for text in told] == [True, False, False, False]
