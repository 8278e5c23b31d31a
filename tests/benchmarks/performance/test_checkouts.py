"""Two checkouts compared: real processes over made-up packages, and this very checkout against itself."""

from __future__ import annotations

import json
import time
from pathlib import Path

import pytest
from click.testing import CliRunner

from benchmarks.performance.checkouts import (
    SCHEMA,
    Checkout,
    CheckoutError,
    PairedFigure,
    compare_checkouts,
    median_interval,
    run_checkout,
    timed_scenarios,
)
from service.cli.main import main
from simcore.scenario.presets import preset
from simcore.scenario.scenario import Scenario

ROOT = Path(__file__).resolve().parents[3]
PACKAGE = """
import time

class Scenario:
    @classmethod
    def load(cls, data):
        scenario = cls()
        scenario.name = data["name"]
        return scenario

class Rollout:
    series = {{"plant_s": [0.0, {plant_s}, {plant_s}, {plant_s}]}}

    def __init__(self, name):
        self.name = name

    def result(self):
        provenance = {{"commit": "{commit}"}}
        digest = self.name + "{digest}"
        return {{"status": "{status}", "message": "why", "digest": digest, "provenance": provenance}}

def run(scenario, observer):
    observer.begin(None, None)
    for number in range(3):
        time.sleep({plant_s})
        observer.step(None)
    rollout = Rollout(scenario.name)
    observer.end(rollout)
    return rollout
"""


def made_up(folder: Path, *, plant_s: float, digest: str = "", status: str = "completed") -> Path:
    """A checkout whose step takes so long."""
    folder.mkdir()
    text = PACKAGE.format(plant_s=plant_s, commit=f"{folder.name}0123456789", digest=digest, status=status)
    (folder / "needlebench.py").write_text(text)
    return folder


def test_the_interval_of_a_median_holds_it_with_the_confidence_asked_for() -> None:
    assert median_interval([1.0, 2.0, 3.0, 4.0, 5.0]) is None  # 2 * 0.5^5 > 0.05
    assert median_interval([6.0, 1.0, 5.0, 2.0, 4.0, 3.0]) == (1.0, 6.0)
    assert median_interval([float(i) for i in range(1, 10)]) == (2.0, 8.0)  # 2 * 10 / 512 outside
    assert median_interval([float(i) for i in range(1, 10)], confidence=0.99) == (1.0, 9.0)


def test_ratios_are_taken_pair_by_pair() -> None:
    assert PairedFigure("line.step_ms", (1.0, 2.0), (2.0, 1.0)).ratios == [2.0, 0.5]


def test_the_scenarios_are_the_built_in_ones() -> None:
    for name, data in timed_scenarios(quick=False).items():
        assert Scenario.load(data) == preset(name)


@pytest.mark.slow
def test_each_run_measures_its_own_checkout(tmp_path: Path) -> None:
    old, new = made_up(tmp_path / "old", plant_s=0.005), made_up(tmp_path / "new", plant_s=0.02, digest="other")
    said: list[str] = []
    found = compare_checkouts(old, new, scratch=tmp_path / "scratch", say=said.append, quick=True)
    assert [line.rpartition(" ")[2] for line in said[2:]] == ["old", "new", "new", "old"]
    keys = ["start_s", "line.plant_ms", "line.step_ms", "sine.plant_ms", "sine.step_ms"]
    assert [figure.key for figure in found.figures] == keys
    figures = {figure.key: figure for figure in found.figures}
    assert figures["line.plant_ms"].ratios == pytest.approx([4.0, 4.0])
    assert min(figures["sine.step_ms"].old) > 4.9  # a sleep is never shorter than asked for
    assert min(figures["sine.step_ms"].new) > 19.9
    assert all(start_s > 0.005 for start_s in figures["start_s"].old)
    assert not found.same_results
    assert (found.old_commit, found.new_commit) == ("old0123456789", "new0123456789")


def test_a_run_that_fails_is_an_error(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    broken = made_up(tmp_path / "broken", plant_s=0.0, status="not_converged")
    with pytest.raises(CheckoutError, match="exit code 1"):
        compare_checkouts(broken, broken, scratch=tmp_path / "scratch", say=lambda _: None, quick=True)
    assert "line ended as not_converged: why" in capfd.readouterr().err


def test_code_from_elsewhere_is_refused(tmp_path: Path) -> None:
    real = made_up(tmp_path / "real", plant_s=0.0)
    folder = tmp_path / "misleading"
    folder.mkdir()
    (folder / "needlebench.py").write_text(
        f"import importlib.util, sys\n"
        f"spec = importlib.util.spec_from_file_location('needlebench', {str(real / 'needlebench.py')!r})\n"
        f"sys.modules['needlebench'] = module = importlib.util.module_from_spec(spec)\n"
        f"spec.loader.exec_module(module)\n"
    )
    with pytest.raises(CheckoutError, match="instead of the checkout's code"):
        run_checkout(Checkout(folder, tmp_path / "kernels"), timed_scenarios(quick=True), clock=time.perf_counter)


@pytest.mark.slow
def test_the_command_prints_and_stores_the_pairs(tmp_path: Path) -> None:
    old, new = made_up(tmp_path / "old", plant_s=0.001), made_up(tmp_path / "new", plant_s=0.001)
    report = tmp_path / "pairs.json"
    done = CliRunner().invoke(main, ["bench", "--checkouts", str(old), str(new), "--quick", "--json", str(report)])
    assert done.exit_code == 0, done.output
    assert "2 pairs of runs; old: old0123456, new: new0123456; results identical" in done.stdout
    stored = json.loads(report.read_bytes())
    assert stored["schema"] == SCHEMA
    assert all(len(sides["old"]) == len(sides["new"]) == 2 for sides in stored["figures"].values())


@pytest.mark.parametrize(
    ("arguments", "why"),
    [
        (["--checkouts", "FOLDER", "FOLDER"], "is not a checkout"),
        (["--checkouts", "FOLDER/nothing", "FOLDER"], "does not exist"),
        (["micro", "--checkouts", "FOLDER", "FOLDER"], "NAME"),
    ],
)
def test_bad_input_of_a_comparison(arguments: list[str], why: str, tmp_path: Path) -> None:
    done = CliRunner().invoke(main, ["bench", *(text.replace("FOLDER", str(tmp_path)) for text in arguments)])
    assert done.exit_code == 2
    assert why in done.stderr


@pytest.mark.long
def test_this_checkout_beside_itself(tmp_path: Path) -> None:
    """The real package, its kernels compiled into an empty cache."""
    found = compare_checkouts(ROOT, ROOT, scratch=tmp_path, say=lambda _: None, quick=True)
    assert found.same_results
    assert all(ratio > 0.0 for figure in found.figures for ratio in figure.ratios)
