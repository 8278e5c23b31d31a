from __future__ import annotations

import os
import re
from pathlib import Path

import pytest
from click.testing import CliRunner

from service.cli.main import main
from service.environment import SettingsError
from service.settings import (
    RUNNER,
    Limits,
    Settings,
    limits_help,
    url_of,
    variables_help,
)
from simcore.remote.link import is_loopback

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(autouse=True)
def no_variables(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in [name for name in os.environ if name.startswith("NEEDLEBENCH_")]:
        monkeypatch.delenv(name)


def load(**variables: str) -> Settings:
    with pytest.MonkeyPatch.context() as patch:
        for name, value in variables.items():
            patch.setenv(name, value)
        return Settings.load()


def test_flags_come_before_variables_and_variables_before_defaults(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("NEEDLEBENCH_HOST", "127.0.0.1")
    monkeypatch.setenv("NEEDLEBENCH_DATA", str(tmp_path))
    settings = Settings.load(host="::1")
    assert (settings.host, settings.data, settings.port, settings.workers) == ("::1", tmp_path, None, 2)


@pytest.mark.parametrize(
    ("name", "value", "told"),
    [
        ("NEEDLEBENCH_WORKERS", "0", "must be 1 to 2"),
        ("NEEDLEBENCH_WORKERS", "3", "must be 1 to 2"),
        ("NEEDLEBENCH_WORKERS", "two", "must be a whole number"),
        ("NEEDLEBENCH_PORT", "65536", "to 65535"),
        ("NEEDLEBENCH_MAX_BODY_MB", "0", "must be 0.001 to 1000"),
        ("NEEDLEBENCH_MAX_UPLOAD_MB", "inf", "must be 0.001 to 200"),
        ("NEEDLEBENCH_MAX_UPLOAD_MB", "many", "must be a number"),
        ("NEEDLEBENCH_MAX_UPLOADS_MB", "0", "must be 0.001 to"),
        ("NEEDLEBENCH_MAX_QUEUE", "0", "must be 1 to"),
        ("NEEDLEBENCH_MAX_QUEUE", "1.5", "must be a whole number"),
        ("NEEDLEBENCH_MAX_QUEUE_PER_KEY", "-1", "must be 1 to"),
        ("NEEDLEBENCH_RATE_PER_KEY", "nan", "must be 0 to"),
        ("NEEDLEBENCH_MAX_NODES", "7", "must be 8 to"),
        ("NEEDLEBENCH_MAX_STEPS", "1000001", "must be 1 to"),
        ("NEEDLEBENCH_MAX_JOB_HOURS", "0", "must be 0.001 to"),
        ("NEEDLEBENCH_JOB_MEMORY_MB", "699", "must be 700 to"),
        ("NEEDLEBENCH_KEEP_DAYS", "0.5", "must be 1 to 36500"),
        ("NEEDLEBENCH_KEEP_DAYS", "month", "must be a number"),
        ("NEEDLEBENCH_KEEP_GB", "nan", "must be 0 to"),
        ("NEEDLEBENCH_API_KEY", "with space", "without spaces"),
        ("NEEDLEBENCH_API_KEY", "schlüssel", "printable ASCII"),
    ],
)
def test_a_setting_out_of_range_is_named_with_its_range(name: str, value: str, told: str) -> None:
    with pytest.raises(SettingsError, match=told) as caught:
        load(**{name: value})
    assert name.removeprefix("NEEDLEBENCH_").lower() in str(caught.value).lower().replace("--", "")


@pytest.mark.parametrize("host", ["0.0.0.0", "::", "192.168.1.5", "lab.example"])
def test_an_address_that_others_reach_needs_a_key_and_the_line_to_type_is_given(host: str, tmp_path: Path) -> None:
    with pytest.raises(SettingsError) as caught:
        Settings.load(host=host, port=9000, data=tmp_path).check_exposure()
    assert f"needlebench serve --host {host} --port 9000" in str(caught.value)
    assert "NEEDLEBENCH_API_KEY" in str(caught.value)
    assert "needlebench key create" in str(caught.value)
    settings = load(NEEDLEBENCH_HOST=host, NEEDLEBENCH_API_KEY="k" * 24)
    settings.check_exposure()
    assert (settings.host, settings.api_key) == (host, "k" * 24)


def test_the_key_is_not_shown() -> None:
    assert "hush" not in repr(load(NEEDLEBENCH_API_KEY="hush"))
    with pytest.raises(SettingsError) as caught:
        load(NEEDLEBENCH_API_KEY="hush hush")
    assert "hush" not in str(caught.value)


@pytest.mark.parametrize(
    ("host", "local"),
    [("localhost", True), ("127.0.0.1", True), ("127.8.8.8", True), ("::1", True), ("0.0.0.0", False), ("a.b", False)],
)
def test_what_loopback_is(host: str, local: bool) -> None:
    assert is_loopback(host) is local


def test_url_of() -> None:
    assert url_of("0.0.0.0", 1) == "http://127.0.0.1:1"
    assert url_of("::1", 2) == "http://[::1]:2"


def test_every_limit_is_read_from_its_variable() -> None:
    for name, item in Limits.model_fields.items():
        low, high = (getattr(bound, side) for bound, side in zip(item.metadata, ("ge", "le"), strict=True))
        value = int(low) + 1 if item.annotation is int else (low + high) / 2
        limits = load(**{str(item.validation_alias): f"{value}"}).limits
        assert getattr(limits, name) == value
        assert limits == Limits().model_copy(update={name: value})


def test_what_is_constructed_is_not_changed_by_the_environment(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("NEEDLEBENCH_WORKERS", "1")
    monkeypatch.setenv("NEEDLEBENCH_MAX_QUEUE", "7")
    assert (Settings().workers, Limits().queue) == (2, 10_000)
    assert (Settings.load().workers, Settings.load().limits.queue) == (1, 7)


def test_an_empty_variable_is_none_and_only_listed_ones_are_read(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("NEEDLEBENCH_API_KEY", "")
    monkeypatch.setenv("NEEDLEBENCH_RUNNER", "os:abort")
    monkeypatch.setenv("NEEDLEBENCH_LIMITS", "{}")
    settings = Settings.load()
    assert (settings.api_key, settings.runner, settings.limits) == (None, RUNNER, Limits())


def test_every_variable_is_in_the_help_and_every_variable_in_the_help_is_read() -> None:
    source = (ROOT / "service" / "settings.py").read_text("utf-8")
    told = CliRunner().invoke(main, ["serve", "--help"]).output
    listed = {name for name, _ in [*variables_help(), *limits_help()]}
    assert set(re.findall(r"NEEDLEBENCH_[A-Z_]+", source)) == listed
    assert all(f"  {name} " in told for name in listed)
