"""Which cluster is meant, and which ones are refused: Dask runs whatever it is sent."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

import pytest
from click.testing import CliRunner

from service.cli.main import main
from service.cluster.address import ClusterAddress
from service.cluster.identity import difference, identity
from simcore.errors import ScenarioError

if TYPE_CHECKING:
    from pathlib import Path


@pytest.mark.parametrize(
    "text", ["tls://10.0.0.5:8786", "tcp://127.0.0.1:8786", "tcp://localhost:1", "tcp://[::1]:8786"]
)
def test_addresses_that_are_taken(text: str) -> None:
    assert ClusterAddress(text).endpoint() == text


@pytest.mark.parametrize("text", ["", "scheduler", "10.0.0.5:8786", "tls://host", "ftp://h:1", "file:", "tcp://h:x"])
def test_addresses_of_another_form_are_refused(text: str) -> None:
    with pytest.raises(ScenarioError, match=r"must be tls://HOST:PORT, tcp://HOST:PORT or file:SCHEDULER\.json"):
        ClusterAddress(text)


def test_plain_tcp_to_another_machine_must_be_wanted() -> None:
    with pytest.raises(ScenarioError, match=r"plain TCP to another machine .* can run code as you: use tls://, or say"):
        ClusterAddress("tcp://10.0.0.5:8786")
    assert ClusterAddress("tcp://10.0.0.5:8786", insecure=True).endpoint() == "tcp://10.0.0.5:8786"


def test_the_file_of_a_scheduler_is_read_each_time(tmp_path: Path) -> None:
    file = tmp_path / "scheduler.json"
    address = ClusterAddress(f"file:{file}")
    assert address.endpoint() is None
    file.write_text('{"address": "tls://10.0.')  # not yet whole
    assert address.endpoint() is None
    file.write_text(json.dumps({"address": "tls://10.0.0.5:1"}))
    assert address.endpoint() == "tls://10.0.0.5:1"
    file.write_text(json.dumps({"address": "tcp://10.0.0.5:1"}))
    with pytest.raises(ScenarioError, match="plain TCP to another machine"):
        address.endpoint()
    file.write_text("[]")
    with pytest.raises(ScenarioError, match="is no file of a scheduler"):
        address.endpoint()


def test_identities_differ_in_words() -> None:
    here = identity()
    assert {"commit", "code", "lock", "numpy", "numba", "python", "distributed"} <= set(here)
    assert difference(here, here) is None
    assert difference({**here, "numpy": "1.0"}, here) == f"numpy is 1.0 there and {here['numpy']} for the campaign"
    assert difference({**here, "lock": None}, {**here, "lock": "a" * 64}) == (
        "lock is unknown there and aaaaaaaaaaaa for the campaign"
    )


def test_a_campaign_of_a_service_takes_no_cluster() -> None:
    result = CliRunner().invoke(main, ["campaign", "run", "lin100-v2-smoke", "--cluster", "tls://h:1"])
    assert result.exit_code == 2
    assert "--cluster = 'tls://h:1': needs --out DIR" in result.output
