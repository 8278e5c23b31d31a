"""The commands that ask a service, typed one after the other: a campaign, its tables, schedules, recordings."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

import pytest
from click.testing import CliRunner, Result

from service.cli.main import main
from service.recording import viewer
from service.settings import RUNNER
from simcore.errors import Status
from simcore.rollout.dataset import load_dataset
from tests.acceptance.server import Server, running_server

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

pytestmark = pytest.mark.slow

SHORT: dict[str, Any] = {
    "name": "short",
    "dt_s": 0.05,
    "tissue": {"element_size_mm": 10},
    "trajectory": {"kind": "line", "target_mm": [18, 31, 15]},
}
GRID = "tissue.young_kpa=4,6.3"
NAME = "two controllers"


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Server]:
    with running_server(tmp_path_factory.mktemp("data"), runner=RUNNER) as running:
        yield running


@pytest.fixture(scope="module")
def campaign(server: Server, tmp_path_factory: pytest.TempPathFactory) -> str:
    """The id of one that has run: two controllers in two tissues."""
    folder = tmp_path_factory.mktemp("campaign")
    scenario, table, page = folder / "short.json", folder / "table.csv", folder / "report.html"
    scenario.write_text(json.dumps(SHORT))
    controllers = ("--controller", "ifem", "--controller", "open_loop")
    files = ("--csv", str(table), "--report", str(page))
    words = ("campaign", "run", "--scenario", str(scenario), *controllers, "--grid", GRID, "--name", NAME, *files)
    planned = typed(server, *words, "--dry-run")
    assert (planned.exit_code, "4 insertions" in planned.stdout) == (0, True), planned.output
    assert not table.exists()
    done = typed(server, *words)
    assert done.exit_code == 0, done.output
    assert len(table.read_text().splitlines()) == 1 + 4
    assert NAME in page.read_text()
    return done.stdout.split()[0]


def typed(server: Server, *words: str) -> Result:
    names = ("NEEDLEBENCH_API_KEY", "NEEDLEBENCH_HOST", "NEEDLEBENCH_PORT", "NEEDLEBENCH_WORKERS")
    here = {"NEEDLEBENCH_URL": server.url, "NEEDLEBENCH_DATA": str(server.data)}
    return CliRunner().invoke(main, words, env={**dict.fromkeys(names), **here})


def lines(server: Server, *words: str) -> list[str]:
    done = typed(server, *words)
    assert done.exit_code == 0, done.output
    return done.stdout.splitlines()


def jobs_of(server: Server, campaign: str) -> dict[str, str]:
    """Case -> the id of its job."""
    return {case["case"]: case["job"] for case in server.client.campaign_cases(campaign)}


def test_a_campaign_is_listed_and_shown(server: Server, campaign: str, tmp_path: Path) -> None:
    (listed,) = [line for line in lines(server, "campaign", "list") if NAME in line]
    assert listed.startswith(campaign)
    assert " done " in listed
    assert json.loads(lines(server, "campaign", "list", "--suite", NAME, "--json")[0])["id"] == campaign
    shown = lines(server, "campaign", "show", campaign, "--csv", str(tmp_path / "a.csv"))
    assert shown[0].startswith(f"{NAME}: done, ")
    assert any("I-FEM" in line or "ifem" in line for line in shown)
    assert len((tmp_path / "a.csv").read_text().splitlines()) == 1 + 4
    scores = json.loads("\n".join(lines(server, "campaign", "show", campaign, "--json")))["scores"]
    assert {score["arm"] for score in scores} == {"ifem", "open_loop"}


def test_its_arms_are_compared_and_its_trend_is_told(server: Server, campaign: str) -> None:
    found = json.loads(
        "\n".join(lines(server, "campaign", "compare", campaign, "--arms", "ifem", "open_loop", "--json"))
    )
    (one,) = [comparison for comparison in found["comparisons"] if comparison["pairs"] == 2]
    assert one["median_first_mm"] < one["median_second_mm"]
    assert lines(server, "campaign", "compare", campaign)
    head, point = lines(server, "campaign", "trend", NAME)
    assert "RCM" in head
    assert campaign in point
    nothing = typed(server, "campaign", "trend", "unheard of")
    assert (nothing.exit_code, "no campaign of unheard of has ended yet" in nothing.stderr) == (0, True)


def test_an_ended_campaign_can_be_cancelled_without_loss(server: Server, campaign: str) -> None:
    (told,) = lines(server, "campaign", "cancel", campaign)
    assert told.startswith(f"{campaign} done: ")


def test_the_suites_of_a_service_are_those_without_one(server: Server) -> None:
    assert lines(server, "campaign", "suites", "--url", server.url) == lines(server, "campaign", "suites")


def test_its_insertions_become_a_data_set_and_a_bundle(server: Server, campaign: str, tmp_path: Path) -> None:
    made = typed(
        server, "dataset", "--from", campaign, "--arm", "ifem", "--samples", "50", "--out", str(tmp_path / "d.npz")
    )
    assert made.exit_code == 0, made.output
    data = load_dataset(tmp_path / "d.npz")
    assert (len(data.drawn), {one["arm"] for one in data.provenance["insertions"]}) == (50, {"ifem"})
    bundle = str(tmp_path / "b.zip")
    identity = lines(server, "bundle", "make", campaign, "--out", bundle, "--sample", "0")[-1]
    checked = typed(server, "bundle", "check", bundle)
    assert checked.exit_code == 0, checked.output
    assert identity.split()[-1] in checked.stdout


def test_a_schedule_is_paused_resumed_triggered_and_removed(server: Server, tmp_path: Path) -> None:
    (tmp_path / "short.json").write_text(json.dumps(SHORT))
    grid = ("--scenario", str(tmp_path / "short.json"), "--grid", "tissue.young_kpa=5")
    added = typed(server, "schedule", "add", "nightly", "0 2 * * *", *grid)
    assert added.exit_code == 0, added.output
    assert any("nightly" in line for line in lines(server, "schedule", "list"))
    assert lines(server, "schedule", "pause", "nightly") == []
    assert server.client.schedules()[0]["enabled"] is False
    (told,) = lines(server, "schedule", "resume", "nightly")
    assert told.startswith("next: 20")
    (ran,) = lines(server, "schedule", "trigger", "nightly")
    (seen,) = lines(server, "schedule", "runs", "nightly")
    assert seen.split()[-1] == ran.split()[-1]
    assert server.client.wait_campaign(ran.split()[-1]).state == "done"
    assert lines(server, "schedule", "remove", "nightly") == []
    unknown = typed(server, "schedule", "runs", "nightly")
    assert (unknown.exit_code, "is not a schedule; there are: none" in unknown.stderr) == (2, True)


@pytest.fixture
def shown(monkeypatch: pytest.MonkeyPatch) -> list[Path]:
    """What the viewer was asked to show."""
    found: list[Path] = []

    def show(path: Path) -> int:
        found.append(path)
        return 0

    monkeypatch.setattr(viewer, "show", show)
    return found


def test_recordings_are_opened_where_they_are_and_put_together(
    server: Server, campaign: str, tmp_path: Path, shown: list[Path]
) -> None:
    first, second = list(jobs_of(server, campaign).values())[:2]
    assert lines(server, "recording", "open", first) == []
    assert shown == [server.data / "jobs" / first / "1" / "recording.rrd"]
    both = tmp_path / "both.rrd"
    assert lines(server, "recording", "together", str(both), first, second) == [str(both)]
    assert both.read_bytes()[:4] == b"RRF2"


def test_a_recording_of_another_machine_is_downloaded_once(
    server: Server, campaign: str, tmp_path: Path, shown: list[Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    job = next(iter(jobs_of(server, campaign).values()))
    monkeypatch.setattr("platformdirs.user_cache_dir", lambda _name: str(tmp_path / "cache"))
    elsewhere = {"NEEDLEBENCH_URL": server.url, "NEEDLEBENCH_DATA": str(tmp_path / "no data of that service")}
    for _ in range(2):
        assert CliRunner().invoke(main, ["recording", "open", job], env=elsewhere).exit_code == 0
    assert shown[0] == shown[1]
    assert shown[0].parent == tmp_path / "cache" / "recordings"
    assert shown[0].read_bytes() == (server.data / "jobs" / job / "1" / "recording.rrd").read_bytes()
    assert server.client.job(job).result["status"] == Status.COMPLETED  # type: ignore[index]
