"""`needlebench mesh`: what it says can be used as it is."""

from __future__ import annotations

import json
import re
import shlex
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner

from service.cli.main import main
from service.cli.meshes import as_text
from simcore.mesh.summary import MeshSummary
from simcore.scenario.presets import start, with_changes
from simcore.scenario.scenario import Scenario

FILES = Path(__file__).parents[2] / "simcore" / "mesh" / "files"
BARREL = Path("service/cli/examples/mesh.msh").resolve()


def summary(*arguments: str) -> dict[str, Any]:
    result = CliRunner().invoke(main, ["mesh", *arguments, "--json"])
    assert result.exit_code == 0, result.output
    return dict(json.loads(result.stdout))


@pytest.mark.slow
def test_a_box_is_described() -> None:
    told = summary(str(FILES / "nset_names.inp"))
    assert (told["nodes"], told["tetrahedra"], told["unit_mm"], told["unit_guessed"]) == (175, 576, 1.0, True)
    assert (told["low_mm"], told["high_mm"]) == ([0, 0, 0], [40, 40, 60])
    assert told["sets"] == {"A": 35, "B": 35, "Fixed": 70, "Tissue": 175}
    assert set(told["flat_sides"]) == {"x_min", "x_max", "y_min", "y_max", "z_min", "z_max"}
    assert 0.0 < told["shape_worst"] <= told["shape_mean"] <= 1.0
    down = told["entries"][0]
    assert (down["entry_mm"], down["inward"], down["depth_mm"]) == ([20, 20, 0], [0, 0, 1], 60)


@pytest.mark.slow
def test_sets_without_nodes_and_what_is_left_out_are_said() -> None:
    told = summary(str(FILES / "refpoint.inp"))
    assert "is empty" in told["sets"]["RP"]
    assert told["left_out"] == ["1 points of no tetrahedron are left out"]


@pytest.mark.slow
@pytest.mark.parametrize(("unit_mm", "arguments"), [(1000.0, []), (10.0, []), (10.0, ["--unit-mm", "10"])])
def test_the_unit_is_guessed_from_the_extents(tmp_path: Path, unit_mm: float, arguments: list[str]) -> None:
    """The box of 40 x 40 x 60 mm in other units; 4 cm is too little for mm."""
    text = (FILES / "nset_union.inp").read_text()
    path = tmp_path / "box.inp"
    number = re.compile(r"-?\d+\.\d+")
    path.write_text(number.sub(lambda match: f"{float(match[0]) / unit_mm:.9f}", text))
    told = summary(str(path), *arguments)
    assert (told["unit_mm"], told["unit_guessed"]) == (unit_mm, not arguments)
    np.testing.assert_allclose(told["high_mm"], [40, 40, 60])


@pytest.mark.slow
def test_the_options_that_it_prints_make_a_scenario() -> None:
    result = CliRunner().invoke(main, ["mesh", str(BARREL)])
    assert result.exit_code == 0
    words = shlex.split(result.stdout.partition("use it with")[2].replace("\\\n", " "))
    changes = [words[i + 1] for i, word in enumerate(words) if word == "--set"]
    scenario = Scenario.load(with_changes(start("line"), changes))
    assert scenario.tissue.fixed_sets == ("base",)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["tangled.vtu", "inc_leak.inp", "fluent_trunc.msh"])
def test_a_mesh_that_cannot_be_used_is_refused(name: str) -> None:
    result = CliRunner().invoke(main, ["mesh", str(FILES / name)])
    assert result.exit_code == 2
    assert result.stdout == ""
    assert result.stderr.startswith("needlebench: tissue.mesh_file = ")


def test_a_name_cannot_act_upon_the_terminal() -> None:
    none: list[float] = []
    sets: dict[str, int | str] = {"a\x1b[31m": 3}
    summary = MeshSummary("0" * 64, 1.0, False, 5, 2, none, none, 9.0, 0.5, 0.5, [], sets, [], ["b\u202e"], [])
    assert all(line.isprintable() for line in as_text("a.msh", summary).split("\n"))
