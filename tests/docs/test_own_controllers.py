"""The recipe that compares a lab's own controllers: short, and it works as it stands, here at a smaller scale."""

from __future__ import annotations

import csv
import json
import os
import subprocess
import sys
import tomllib
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from tests.docs.snippets import Snippet, snippets
from tests.docs.sources import DOCS, ROOT

if TYPE_CHECKING:
    from pathlib import Path

PAGE = DOCS / "recipes.md"
MOST_LINES = 60
ARMS = ("ifem", "elm", "pi", "regressor")


def recipe() -> list[Snippet]:
    """Its blocks: the package, its pyproject.toml, the preparation, the commands."""
    lines = PAGE.read_text(encoding="utf-8").splitlines()
    begin = lines.index("## Your own controllers in a comparison, in sixty lines") + 1
    end = next(number for number in range(begin, len(lines)) if lines[number].startswith("## ")) + 1
    return [one for one in snippets(PAGE) if begin < one.line < end]


def test_the_recipe_is_short() -> None:
    written = [line for one in recipe() for line in one.text.splitlines() if line.strip()]
    assert len(written) < MOST_LINES, len(written)


def lay_down(folder: Path) -> None:
    """The package as `pip install --editable` leaves it, and what the preparation writes, on short and coarse paths."""
    package, project, preparation, _ = (one.text for one in recipe())
    (folder / "lab").mkdir()
    (folder / "lab" / "__init__.py").write_text(package)
    named = tomllib.loads(project)["project"]
    points = named["entry-points"]["needlebench.controllers"]
    info = folder / f"{named['name']}-{named['version']}.dist-info"
    info.mkdir()
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {named['name']}\nVersion: {named['version']}\n")
    lines = "".join(f"{name} = {value}\n" for name, value in points.items())
    (info / "entry_points.txt").write_text(f"[needlebench.controllers]\n{lines}")
    coarse = ("--set", "tissue.element_size_mm=12", "--set", "dt_s=0.05", "--set", "trajectory.speed_mm_s=50")
    needlebench(folder, "dataset", "--out", "out/ifem.npz", "--insertions", "2", *coarse)
    subprocess.run([sys.executable, "-c", preparation], cwd=folder, env=environment(folder), check=True)
    paths = json.loads((folder / "paths.json").read_text())
    assert [path["kind"] for path in paths] == 10 * ["line"] + 10 * ["sine"] + 10 * ["waypoints"]
    (folder / "paths.json").write_text(json.dumps([shorter(path) for path in paths[::10]]))
    (folder / "coarse.json").write_text('{"dt_s": 0.02, "tissue": {"element_size_mm": 12}}')


def shorter(path: dict[str, Any]) -> dict[str, Any]:
    """A third of the path, no more bent: what is across it is a ninth."""
    entry = np.array([18.0, 31.0, 0.0])
    if path["kind"] == "waypoints":
        middle, end = np.array(path["points_mm"])
        across = middle - (entry + end) / 2
        third = (entry + end) / 2 - entry
        return {**path, "points_mm": [(entry + third / 3 + across / 9).tolist(), (entry + 2 * third / 3).tolist()]}
    end = entry + (np.array(path["target_mm"]) - entry) / 3
    bent = {"amplitude_mm": path["amplitude_mm"] / 9} if path["kind"] == "sine" else {}
    return {**path, "target_mm": end.tolist(), **bent}


def environment(folder: Path) -> dict[str, str]:
    return {**os.environ, "PYTHONPATH": os.pathsep.join([str(ROOT), str(folder)])}


def needlebench(folder: Path, *words: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "service.cli", *words]
    done = subprocess.run(command, cwd=folder, env=environment(folder), capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    return done


@pytest.mark.slow
def test_own_controllers_are_compared_by_one_command(tmp_path: Path) -> None:
    lay_down(tmp_path)
    *_, command = recipe()[-1].commands
    done = needlebench(tmp_path, *command.split()[1:], "--scenario", "coarse.json", "--data", "data")
    with (tmp_path / "table.csv").open() as file:
        table = list(csv.DictReader(file))
    assert {line["arm"] for line in table} == set(ARMS)
    assert len(table) == 12
    assert all(line["stable"] == "yes" for line in table), [line["message"] for line in table]
    assert len({line["arm_id"] for line in table}) == 4
    assert {line["arm_version"] for line in table if line["arm"] in ("pi", "regressor")} == {"0.1"}
    assert len({line["id"] for line in table if line["id"].startswith("pi, waypoints")}) == 1
    assert "sign test over 3 cases: p = 1 (to reach 0.05, 8 are needed)" in done.stdout
    assert "interquartile mean of the RMSE, with 95 % intervals, over the 3 cases that all arms ran" in done.stdout
    assert "the model of the controller was trained" in done.stderr
    assert "constant" not in done.stdout
    page = (tmp_path / "report.html").read_text()
    assert all(words in page for words in ("What ran", "Interquartile mean", "trained at", "regressor"))
