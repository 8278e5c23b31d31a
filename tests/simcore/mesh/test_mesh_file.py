"""Meshes from files: the box read back is the box, other shapes run, every fault of a file is one clear sentence."""

from __future__ import annotations

import hashlib
import os
import shutil
from pathlib import Path
from typing import TYPE_CHECKING, Any

import meshio
import numpy as np
import pytest
from numpy.typing import NDArray

from simcore.errors import Problem, ScenarioError, Status
from simcore.file_names import names_mean, nothing
from simcore.mesh.mesh import BoxMesh, box_mesh
from simcore.mesh.reader import MAXIMUM_MB, load_mesh
from simcore.rollout.rollout import run
from simcore.scenario.build import tissue_model
from simcore.scenario.held_parts import held_of
from simcore.scenario.mesh_rules import MAXIMUM_FACTOR_MB
from simcore.scenario.scenario import Scenario
from tests.simcore.block import BLOCK_MM, block_scenario

if TYPE_CHECKING:
    from collections.abc import Callable

    from simcore.rollout.result import Rollout

Vector = NDArray[np.float64]
BOX = box_mesh(np.array(BLOCK_MM) * 1e-3, (2, 4, 6))
SPACING = {"spacing_mm": 11.0}
FORMATS = ["gmsh4.msh", "gmsh2.msh", "ascii.msh", "box.vtu", "box.vtk", "box.mesh", "box.inp"]


def triangles_on(mesh: BoxMesh, face: str) -> NDArray[np.int64]:
    on_it: NDArray[np.int64] = mesh.surface_triangles[np.isin(mesh.surface_triangles, mesh.faces[face]).all(axis=1)]
    return on_it


def gmsh_text(points: Vector) -> str:
    """The box as Gmsh itself writes it (4.1, ASCII): physical groups `liver`, a volume, and `ribs`, a surface."""
    sides = np.concatenate([triangles_on(BOX, "y_min"), triangles_on(BOX, "y_max")])
    count, bounds = len(points), " ".join("0" for _ in range(6))
    lines = ["$MeshFormat", "4.1 0 8", "$EndMeshFormat"]
    lines += ["$PhysicalNames", "2", '2 8 "ribs"', '3 7 "liver"', "$EndPhysicalNames"]
    lines += ["$Entities", "0 0 1 1", f"4 {bounds} 1 8 0", f"1 {bounds} 1 7 1 4", "$EndEntities"]
    lines += ["$Nodes", f"1 {count} 1 {count}", f"3 1 0 {count}", *(str(i + 1) for i in range(count))]
    lines += [*(" ".join(f"{c:.17g}" for c in point) for point in points), "$EndNodes"]
    cells = [(2, 4, 2, sides + 1), (3, 1, 4, BOX.tets + 1)]
    total = sum(len(block) for *_, block in cells)
    lines += ["$Elements", f"{len(cells)} {total} 1 {total}"]
    number = 0
    for dimension, entity, kind, block in cells:
        lines.append(f"{dimension} {entity} {kind} {len(block)}")
        for cell in block:
            number += 1
            lines.append(" ".join(map(str, [number, *cell])))
    return "\n".join([*lines, "$EndElements", ""])


def write_box(folder: Path, name: str, unit_mm: float = 1.0) -> tuple[Path, str]:
    """The box of the tests in a file, and the name that stands there for the nodes of y = 0 and y = 40 mm."""
    points, path, suffix = BOX.nodes_m * 1e3 / unit_mm, folder / name, Path(name).suffix
    held = np.isin(np.arange(len(points)), [*BOX.faces["y_min"], *BOX.faces["y_max"]])
    tets = [("tetra", BOX.tets)]
    if name == "gmsh2.msh":
        sides = np.concatenate([triangles_on(BOX, "y_min"), triangles_on(BOX, "y_max")])
        groups = [np.full(len(BOX.tets), 7), np.full(len(sides), 8)]
        mesh = meshio.Mesh(
            points,
            [*tets, ("triangle", sides)],
            cell_data={"gmsh:physical": groups, "gmsh:geometrical": groups},
            field_data={"liver": np.array([7, 3]), "ribs": np.array([8, 2])},
        )
        mesh.write(path, file_format="gmsh22")
        return path, "ribs"
    if name == "ascii.msh":
        path.write_text(gmsh_text(points))
        return path, "ribs"
    if suffix == ".inp":
        meshio.Mesh(points, tets, point_sets={"RIBS": np.flatnonzero(held)}).write(path)
        return path, "RIBS"
    if suffix == ".mesh":  # where cells have numbers of their own
        held_ref = held.astype(np.int64)
        meshio.Mesh(points, tets, point_data={"medit:ref": held_ref}).write(path)
        return path, "medit:vertices=1"
    array = "ribs"
    mesh = meshio.Mesh(points, tets, point_data={array: held.astype(np.int64 if suffix != ".msh" else float)})
    mesh.write(path, **({"file_format": "gmsh"} if suffix == ".msh" else {}))
    return path, f"{array}=1"


def box_fields(path: Path, **tissue: Any) -> dict[str, Any]:
    """`block_scenario` with its tissue from a file."""
    data = block_scenario(interaction=SPACING).resolved()
    data["tissue"] = {"mesh_file": str(path), **tissue}
    return data


def problems(data: dict[str, Any]) -> list[Problem]:
    with pytest.raises(ScenarioError) as refused:
        Scenario.load(data)
    return refused.value.problems


def only_problem(data: dict[str, Any], field: str) -> str:
    """The message of the one problem, which must be of this field and of one line."""
    found = problems(data)
    assert [problem.field for problem in found] == [field], found
    assert "\n" not in str(found[0])
    return found[0].message


# the box from a file is the box


@pytest.mark.slow
@pytest.mark.parametrize("name", FORMATS)
def test_every_format_gives_the_box_back(tmp_path: Path, name: str, capfd: pytest.CaptureFixture[str]) -> None:
    """Nodes, tetrahedra, held nodes, size; the readers' own chatter is not let through."""
    path, held = write_box(tmp_path, name)
    capfd.readouterr()
    scenario = Scenario.load(box_fields(path, fixed_sets=[held]))
    assert capfd.readouterr() == ("", "")
    model, box = tissue_model(scenario.tissue), tissue_model(block_scenario().tissue)
    np.testing.assert_allclose(model.mesh.nodes_m, box.mesh.nodes_m, atol=1e-15)
    assert {tuple(t) for t in np.sort(model.mesh.tets)} == {tuple(t) for t in np.sort(box.mesh.tets)}
    np.testing.assert_array_equal(model.unknown < 0, box.unknown < 0)
    assert scenario.tissue.size_mm == BLOCK_MM
    assert (scenario.tissue.fixed_faces, scenario.tissue.held_faces) == (None, ())
    assert scenario.tissue.element_size_mm == pytest.approx(1200.0 ** (1 / 3), abs=1e-6)  # 48 cells
    assert scenario.tissue.mesh_sha256 == hashlib.sha256(path.read_bytes()).hexdigest()


def insertion_run(tissue: dict[str, Any], **trajectory: Any) -> Rollout:
    """An oblique insertion of 25 mm, bent by a sine; 10 mm of block behind the tip are left."""
    data = block_scenario(
        interaction=SPACING,
        trajectory={"kind": "sine", "target_mm": [14.0, 22.0, 25.0], "speed_mm_s": 40.0, **trajectory},
    ).resolved()
    data["tissue"] = tissue
    return run(Scenario.load(data))


@pytest.mark.slow
@pytest.mark.parametrize("name", ["gmsh4.msh", "box.vtu"])
def test_the_box_from_a_file_gives_the_path_of_the_box(tmp_path: Path, name: str) -> None:
    """Point location, balls at the surface, normals, numbering: to 1e-9 m in the tip, at every step."""
    path, held = write_box(tmp_path, name)
    built_in = insertion_run({"size_mm": BLOCK_MM, "element_size_mm": 10.0})
    from_file = insertion_run({"mesh_file": str(path), "fixed_sets": [held]})
    assert built_in.status is from_file.status is Status.COMPLETED
    assert from_file.series["depth_m"][-1] > 0.015
    np.testing.assert_allclose(from_file.series["tip_m"], built_in.series["tip_m"], atol=1e-9)
    np.testing.assert_allclose(from_file.series["base_force_n"], built_in.series["base_force_n"], atol=1e-6)


@pytest.mark.slow
def test_flat_sides_of_the_bounding_box_can_be_held_too(tmp_path: Path) -> None:
    """Without fixed_sets the default is that of the block; both together are united."""
    path, held = write_box(tmp_path, "box.vtu")
    plain = Scenario.load(box_fields(path)).tissue
    both = Scenario.load(box_fields(path, fixed_faces=["x_max"], fixed_sets=[held])).tissue
    mesh = tissue_model(plain).mesh
    assert plain.held_faces == ("y_min", "y_max")
    np.testing.assert_array_equal(held_of(plain, mesh), np.union1d(BOX.faces["y_min"], BOX.faces["y_max"]))
    expected = np.unique(np.concatenate([BOX.faces[face] for face in ("x_max", "y_min", "y_max")]))
    np.testing.assert_array_equal(held_of(both, tissue_model(both).mesh), expected)


@pytest.mark.slow
@pytest.mark.parametrize("unit_mm", [1000.0, 25.4])
def test_units(tmp_path: Path, unit_mm: float) -> None:
    """A file in metres or inches: mesh_unit_mm says so."""
    path, held = write_box(tmp_path, "box.vtu", unit_mm)
    tissue = Scenario.load(box_fields(path, fixed_sets=[held], mesh_unit_mm=unit_mm)).tissue
    assert tissue.size_mm == pytest.approx(BLOCK_MM)
    assert "mesh_unit_mm" in only_problem(box_fields(path, mesh_unit_mm=unit_mm * 1e-2), "tissue.mesh_file")


@pytest.mark.slow
def test_inverted_tetrahedra_and_loose_points_are_repaired(tmp_path: Path) -> None:
    """Every third tetrahedron inside out, points that nothing uses at the front: the same run, to the last bit."""
    path, loose = tmp_path / "box.vtu", tmp_path / "loose.vtu"
    meshio.Mesh(BOX.nodes_m * 1e3, [("tetra", BOX.tets)]).write(path)
    tets = BOX.tets.copy() + 5
    tets[::3] = tets[::3][:, [0, 2, 1, 3]]
    points = np.concatenate([np.full((5, 3), np.nan), BOX.nodes_m * 1e3])
    meshio.Mesh(points, [("tetra", tets)]).write(loose)
    steps = {"target_mm": [13.0, 20.0, 8.0], "amplitude_mm": 0.2}
    runs = [insertion_run({"mesh_file": str(file)}, **steps) for file in (path, loose)]
    assert runs[0].digest == runs[1].digest


# the digest of the content


@pytest.mark.slow
def test_the_resolved_scenario_names_the_content(tmp_path: Path) -> None:
    """Loaded again it is the same; with another content under the same name it is refused, at load and in a run."""
    path, held = write_box(tmp_path, "box.vtu")
    scenario = Scenario.load(box_fields(path, fixed_sets=[held]))
    resolved = scenario.resolved()
    assert Scenario.load(resolved) == scenario
    meshio.Mesh(BOX.nodes_m * 1.01e3, [("tetra", BOX.tets)]).write(path)
    assert "has changed" in only_problem(resolved, "tissue.mesh_file")
    with pytest.raises(ScenarioError, match="has changed"):
        run(scenario)
    path.unlink()
    with pytest.raises(ScenarioError, match="cannot be read: No such file"):
        run(scenario)


def test_files_are_not_opened_where_they_are_not_allowed(tmp_path: Path) -> None:
    """A pipe would hang whoever opens it; a file that is there and one that is not look the same."""
    pipe = a_pipe(tmp_path)
    path, _ = write_box(tmp_path, "box.vtu")
    with names_mean(nothing):
        messages = {only_problem(box_fields(p), "tissue.mesh_file") for p in (pipe, path, tmp_path / "no.msh")}
    assert len(messages) == 1
    assert "not accepted here" in messages.pop()


@pytest.mark.parametrize(
    ("field", "value"), [("fixed_sets", ["ribs"]), ("mesh_unit_mm", 1000.0), ("mesh_sha256", "0" * 64)]
)
def test_fields_of_a_mesh_file_need_one(field: str, value: object) -> None:
    message = only_problem({"tissue": {field: value}}, f"tissue.{field}")
    assert "mesh_file" in message


# bad files


def written(folder: Path, points: Vector, cells: Any, name: str = "bad.vtu") -> Path:
    meshio.Mesh(points, cells).write(folder / name)
    return folder / name


def without_content(folder: Path, name: str, content: bytes = b"") -> Path:
    (folder / name).write_bytes(content)
    return folder / name


def truncated(folder: Path, name: str) -> Path:
    path, _ = write_box(folder, name)
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    return path


def renamed(folder: Path) -> Path:
    return Path(shutil.copy(write_box(folder, "box.vtu")[0], folder / "box.msh"))


def a_folder(folder: Path) -> Path:
    (folder / "folder.msh").mkdir()
    return folder / "folder.msh"


def a_pipe(folder: Path) -> Path:
    os.mkfifo(folder / "pipe.msh")
    return folder / "pipe.msh"


def changed(points: Vector, row: int, value: float) -> Vector:
    points = points.copy()
    points[row, 1] = value
    return points


MM = BOX.nodes_m * 1e3
TETS = [("tetra", BOX.tets)]
FAR = MM + np.array([0.0, 0.0, 100.0])
BAD: list[tuple[Callable[[Path], Path], str]] = [
    (lambda f: f / "none.msh", "cannot be read: No such file"),
    (lambda f: f / "box.stl", "must end in .msh, .vtu, .vtk, .mesh, .inp"),
    (lambda f: f, "must end in"),
    (a_folder, "is not a file"),
    (a_pipe, "is not a file"),
    (lambda f: Path("bad\0.msh"), "cannot be read"),
    *((lambda f, s=s: without_content(f, f"empty{s}"), "") for s in (".msh", ".vtu", ".vtk", ".mesh", ".inp")),
    (lambda f: without_content(f, "noise.msh", bytes(range(256)) * 9), "is not a mesh that can be read (Gmsh): line 1"),
    (lambda f: without_content(f, "noise.vtu", bytes(range(256)) * 9), "is not a mesh that can be read (VTU): line 1"),
    (lambda f: without_content(f, "text.mesh", b"no mesh at all\n"), "(Medit): line 1"),
    *((lambda f, n=n: truncated(f, n), "") for n in FORMATS),
    (renamed, "is not a mesh that can be read (Gmsh): line 1"),
    (lambda f: written(f, MM, [("triangle", BOX.surface_triangles)]), "must hold tetrahedra; it holds triangle"),
    (lambda f: written(f, MM, [("hexahedron", BOX.tets[:2].reshape(1, 8))]), "no other solid cells; it holds hexa"),
    (lambda f: written(f, MM, [*TETS, ("tetra10", np.arange(10)[None])]), "no other solid cells; it holds tetra10"),
    (lambda f: written(f, changed(MM, 17, np.nan), TETS), "not finite"),
    (lambda f: written(f, changed(MM, 17, np.inf), TETS), "not finite"),
    (lambda f: written(f, changed(MM, 0, 1e300), TETS), "bounding box"),
    (lambda f: written(f, MM * 1e-3, TETS), "is tissue.mesh_unit_mm right?"),
    (lambda f: written(f, MM * 100.0, TETS), "each edge must be 10 to 500"),
    (lambda f: written(f, MM + 2e4, TETS), "must lie within +-10000"),
    (lambda f: written(f, MM * [1.0, 1.0, 0.0], TETS), "each edge must be 10 to 500"),
    (lambda f: written(f, MM, [("tetra", BOX.tets + 90)]), "a tetrahedron with node 109; its points are 0 to 104"),
    (lambda f: written(f, MM, [("tetra", BOX.tets - 1)]), "a tetrahedron with node -1"),
    (lambda f: written(f, MM, [*TETS, ("tetra", BOX.tets[:1, [0, 0, 1, 2]])]), "1 flat tetrahedra, such as number 288"),
    (lambda f: written(f, MM, [*TETS, *TETS]), "overlapping"),
    (lambda f: written(f, np.concatenate([MM, FAR]), [*TETS, ("tetra", BOX.tets + len(MM))]), "2 parts"),
]


@pytest.mark.slow
@pytest.mark.parametrize("case", range(len(BAD)))
def test_a_bad_file_is_one_clear_sentence(tmp_path: Path, case: int, capfd: pytest.CaptureFixture[str]) -> None:
    """Field, value and what is wrong; nothing printed, no other exception."""
    make, words = BAD[case]
    path = make(tmp_path)
    capfd.readouterr()
    message = only_problem(box_fields(path, fixed_faces=["y_min"]), "tissue.mesh_file")
    assert words in message
    assert str(tmp_path) not in message
    assert "needlebench-mesh-" not in message
    assert capfd.readouterr() == ("", "")


@pytest.mark.slow
def test_a_node_shared_by_two_bodies_does_not_join_them(tmp_path: Path) -> None:
    """A hinge would be a mechanism: parts must share faces."""
    other = BOX.tets + len(MM)
    corner = int(np.argmax(MM.sum(axis=1)))
    other[other == len(MM)] = corner  # the second box hangs on the far corner of the first
    path = written(tmp_path, np.concatenate([MM, MM + MM[corner]]), [*TETS, ("tetra", other)])
    assert "2 parts" in only_problem(box_fields(path), "tissue.mesh_file")


def test_huge_files_are_not_read(tmp_path: Path) -> None:
    """By their size on disk, before anything is read."""
    path = tmp_path / "huge.msh"
    with path.open("wb") as file:
        file.truncate((MAXIMUM_MB + 1) * 1_000_000)
    assert f"holds {MAXIMUM_MB + 1} MB, at most {MAXIMUM_MB}" in only_problem(box_fields(path), "tissue.mesh_file")


@pytest.mark.slow
def test_a_mesh_too_fine_for_the_memory_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The factor of the box needs 0.06 MB, the limit is put below."""
    assert MAXIMUM_FACTOR_MB == 2000
    monkeypatch.setattr("simcore.scenario.mesh_rules.MAXIMUM_FACTOR_MB", 0.01)
    path, _ = write_box(tmp_path, "box.vtu")
    assert "needs a factor of" in only_problem(box_fields(path), "tissue.mesh_file")


@pytest.mark.parametrize("value", [3, "", "x" * 2000, ["a.msh"], {"path": "a.msh"}, True])
def test_a_wrong_value_of_the_field(value: object) -> None:
    assert {problem.field for problem in problems({"tissue": {"mesh_file": value}})} == {"tissue.mesh_file"}


@pytest.mark.slow
def test_one_file_is_read_once(tmp_path: Path) -> None:
    """Validation and run ask for the same mesh."""
    path, _ = write_box(tmp_path, "box.vtu")
    meshes = [load_mesh(str(path), unit_mm=1.0, names=(), sha256=None) for _ in range(2)]
    assert meshes[0] is meshes[1]
