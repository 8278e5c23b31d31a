"""Small files of every format that readers get wrong: each is read right, or refused with the reason and the place."""

from __future__ import annotations

import base64
import codecs
import contextlib
import random
import struct
import sys
import zlib
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest

from simcore.errors import ScenarioError
from simcore.mesh import reading_process
from simcore.mesh.reader import load_mesh
from simcore.mesh.reading import MeshFaultError, read_body
from simcore.mesh.reading_process import read_apart

if TYPE_CHECKING:
    from collections.abc import Iterator

    from simcore.mesh.reading import Body

FILES = Path(__file__).parent / "files"


def body(name: str, *sets: str, unit_mm: float | None = 1.0) -> Body:
    return read_body((FILES / name).read_bytes(), Path(name).suffix, sets, unit_mm)


def refusal(data: bytes, suffix: str, *sets: str) -> str:
    with pytest.raises(MeshFaultError) as caught:
        read_body(data, suffix, sets, 1.0)
    return caught.value.message


UNION = body("nset_union.inp", "Fixed")


@pytest.mark.parametrize(
    ("name", "held", "count"),
    [
        ("nset_union.inp", "Fixed", 70),
        ("nset_twice.inp", "Fixed", 70),
        ("nset_names.inp", "Fixed", 70),
        ("node_nset.inp", "Nall", 175),
        ("elset_between.inp", "Base", 70),
        ("nset_gen2.inp", "Fixed", 30),
        ("c3d4h.inp", "Tissue", 175),
        ("lower.inp", "tissue", 175),
        ("lower.inp", "Tissue", 175),
        ("with_mass.inp", "Tissue", 175),
        ("node_two_blocks.inp", "Tissue", 175),
    ],
)
def test_an_abaqus_file_gives_the_same_box_and_its_sets(name: str, held: str, count: int) -> None:
    read = body(name, held)
    np.testing.assert_array_equal(read.points, UNION.points)
    assert {tuple(t) for t in np.sort(read.tets)} == {tuple(t) for t in np.sort(UNION.tets)}
    assert len(read.sets[held]) == count


@pytest.mark.parametrize("name", ["nset_union.inp", "box_groups_saveall.msh", "sphere_v1.0_asc.msh"])
def test_a_byte_order_mark_before_the_text_means_nothing(name: str) -> None:
    data = (FILES / name).read_bytes()
    plain, marked = (read_body(start + data, Path(name).suffix, None, None) for start in (b"", codecs.BOM_UTF8))
    np.testing.assert_array_equal(marked.points, plain.points)
    assert marked.names == plain.names


def test_sets_that_add_up_are_the_same_nodes() -> None:
    for name in ("nset_twice.inp", "nset_names.inp"):
        np.testing.assert_array_equal(body(name, "Fixed").sets["Fixed"], UNION.sets["Fixed"])


def test_elements_of_a_set_between_two_blocks_are_those_with_its_numbers() -> None:
    """Elements 1 to 144 are one quarter of the box, x to 10 mm."""
    read = body("elset_between.inp", "Base")
    base = read.points[read.sets["Base"]]
    assert base[:, 0].max() == 40.0
    assert base[:, 1].max() == 10.0


@pytest.mark.parametrize("name", ["instance_translated.inp", "refpoint.inp"])
def test_the_instance_of_a_part_is_moved(name: str) -> None:
    read = body(name, "Fixed")
    np.testing.assert_allclose(read.points, UNION.points + np.array([100.0, 0.0, 0.0]))
    assert len(read.sets["Fixed"]) == 35


def test_what_is_left_out_is_said() -> None:
    assert body("with_mass.inp").remarks == ("1 elements of type MASS are left out",)
    assert "1 points of no tetrahedron" in body("refpoint.inp").remarks[0]


def test_gmsh_with_every_entity_saved_keeps_its_groups() -> None:
    read = body("box_groups_saveall.msh", "left", "held", "fond fixé ü", "tissue")
    assert {name: len(nodes) for name, nodes in read.sets.items()} == {
        "left": 57,
        "held": 114,
        "fond fixé ü": 44,
        "tissue": 290,
    }
    assert set(read.points[read.sets["left"]][:, 1]) == {0.0}
    assert len(body("box_groups_saveall22.msh").tets) == len(read.tets)
    data = (FILES / "box_groups_saveall22.msh").read_bytes()
    assert "group without an element" in refusal(data, ".msh", "left")


def test_gmsh_formats_1_and_4_0_hold_the_same_sphere() -> None:
    first, fourth = body("sphere_v1.0_asc.msh"), body("sphere_v4.0_asc.msh")
    assert (len(first.points), len(first.tets)) == (len(fourth.points), len(fourth.tets)) == (470, 1817)
    np.testing.assert_allclose(np.linalg.norm(first.points, axis=1).max(), 40.0)


def test_a_tangled_mesh_is_refused_with_number_and_place() -> None:
    message = refusal((FILES / "tangled.vtu").read_bytes(), ".vtu")
    assert "6 of its tetrahedra are turned inside out" in message
    assert "around [17.5, 15, 36.75] mm" in message


@pytest.mark.parametrize("name", ["inc_leak.inp", "include_abs.inp"])
def test_no_other_file_is_opened(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Whether it is there or not, the sentence is the same; nothing is opened while the content is read."""
    monkeypatch.chdir(FILES)
    data, opened = (FILES / name).read_bytes(), list[object]()
    sys.addaudithook(lambda event, arguments: opened.append(arguments) if event == "open" and watching else None)
    watching = True
    message = refusal(data, ".inp")
    absent = refusal(b"*INCLUDE, INPUT=/no/such/file\n", ".inp")
    watching = False
    assert opened == []
    assert message == absent
    assert "line 1: *INCLUDE takes its data from another file" in message
    assert "lab-note" not in message


def test_nodes_of_another_file_are_refused() -> None:
    assert "line 1: *NODE takes its data" in refusal(b"*NODE, INPUT=secret_ids.csv\n", ".inp")


ABAQUS = [
    ("*NODE, SYSTEM=C\n1, 1., 90., 0.\n", "line 1: nodes in the system C"),
    ("*NODE\n1, 0, 0, 0\n1, 1, 0, 0\n", "line 3: node 1 is defined a second time"),
    ("*NODE\n1, 0, 0, zero\n", "line 2: '0, 0, zero' are not coordinates"),
    ("*NODE\n1, 0, 0\n*NGEN\n1, 2, 1\n", "line 3: *NGEN is not read"),
    ("*ELEMENT, TYPE=C3D8R\n1, 1, 2, 3, 4, 5, 6, 7, 8\n", "line 1: must hold linear tetrahedra"),
    ("*ELEMENT, TYPE=C3D4\n1, 1, 2, 3\n", "line 2: C3D4 has 4 nodes, here are 3"),
    ("*NODE\n1, 0, 0, 0\n*NSET, NSET=A\n1, B\n", "line 4: 'B' is neither a number nor a set"),
    ("*NODE\n1, 0, 0, 0\n*NSET, NSET=A\n1, 7\n", "line 4: has a set with node 7"),
    ("*NODE\n1, 0, 0, 0\n*NSET, NSET=A, GENERATE\n1, 8, 2\n", "line 4: '1, 8, 2' is not first, last, increment"),
    ("*NODE\n1, 0, 0, 0\n*NSET, NSET=A, GENERATE\n1, 900000000000, 1\n", "line 4: holds more than"),
    ("*NODE\n1, 0, 0, 0\n*NSET, NSET=A\n1\n*NSET, NSET=B\nA\n*NODE, NSET=A\n2, 0, 0, 1\n", "line 7: the set 'A' grows"),
    ("*PART, NAME=A\n*END PART\n*PART, NAME=B\n", "line 3: holds a second part"),
    ("*INSTANCE, NAME=A\n*END INSTANCE\n*INSTANCE, NAME=B\n", "line 3: holds a second instance"),
    ("*INSTANCE, NAME=A\n0, 0, 1\n0, 0, 0, 1, 0, 0, 90\n*END INSTANCE\n", "line 3: the instance is turned"),
    ("1, 2, 3\n", "line 1: the file must begin with a keyword"),
    ("*NODE\n\u0661, 0, 0, 0\n", "line 2: '\u0661' is not a number of *NODE"),
    ("*NODE\n1, 1_0, 0, 0\n", "line 2: '1_0, 0, 0' are not coordinates"),
    ("*NODE\n1, nan, 0, inf\n", "line 2: 'nan, 0, inf' are not coordinates"),
    ("*NODE\n1, 0, 0, 0\n*INCL, INPUT=/etc/passwd\n", "line 3: *INCL is no keyword: spell it out"),
    ("*NODE\n1, 0, 0, 0\n*NSE, NSET=A\n1\n", "line 3: *NSE is no keyword: spell it out"),
    ("*NODE\n1, 0, 0, 0\n* include,\n INPUT = /etc/passwd\n", "*INCLUDE takes its data from another file"),
    ("*NODE\n1, 0, 0, 0\n*NSET, NSET=A\nA\n", "line 4: 'A' is neither a number nor a set"),
    ("*NODE\n1, 0, 0, 0\n" + "".join(f"*NSET, NSET=A{i}\n1\n" for i in range(1001)), "at most 1000 sets"),
    (f"*NODE\n1, 0, 0, 0\n*NSET, NSET={'A' * 201}\n1\n", "names of at most 200 characters"),
]


@pytest.mark.parametrize(("text", "words"), ABAQUS)
def test_what_would_be_read_wrong_is_refused_with_its_line(text: str, words: str) -> None:
    assert words in refusal(text.encode(), ".inp")


@pytest.mark.parametrize(
    ("data", "suffix", "words"),
    [
        ((FILES / "fluent_trunc.msh").read_bytes(), ".msh", "is a Fluent mesh"),
        (b"$MeshFormat\n4.1 0 8\n$EndMeshFormat\n$PartitionedEntities\n", ".msh", "line 4: the mesh is partitioned"),
        (b"$MeshFormat\n3 0 8\n$EndMeshFormat\n", ".msh", "line 2: is of Gmsh's format 3"),
        (b"$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$Nodes\n1\n1 0 x 0\n", ".msh", "line 6: 'x' is not a number"),
        (b"$NOD\n90000000000\n", ".msh", "announces 90000000000 points"),
        (b"MeshVersionFormatted 3\nDimension 2\n", ".mesh", "line 2: must be of dimension 3"),
        (b"MeshVersionFormatted 2\nDimension 3\nTetrahedraP2\n1\n", ".mesh", "line 3: 'TetrahedraP2' is no section"),
        (b"# vtk DataFile Version 3.0\nx\nASCII\nDATASET POLYDATA\n", ".vtk", "line 4: must be a grid of type"),
        (b'<?xml version="1.0"?><VTKFile type="PolyData"/>', ".vtk", "it is PolyData"),
        (b'<!DOCTYPE a [<!ENTITY b "c">]><VTKFile/>', ".vtu", "declares a document type"),
    ],
)
def test_what_is_not_promised_is_refused_kindly(data: bytes, suffix: str, words: str) -> None:
    assert words in refusal(data, suffix)


def test_xml_in_a_vtk_file_is_read() -> None:
    assert "6 of its tetrahedra" in refusal((FILES / "tangled.vtu").read_bytes(), ".vtk")


@pytest.mark.parametrize("version", [b"1", b"2", b"3"])
def test_medit_of_any_version_and_its_numbers(version: bytes) -> None:
    """The same number means nodes, triangles and tetrahedra; where these differ, it must be said which."""
    corners = "".join(f"{x} {y} {z} {int(x == 0)}\n" for x, y, z in [(0, 0, 0), (20, 0, 0), (0, 20, 0), (0, 0, 20)])
    text = b"MeshVersionFormatted " + version + b"\n# by hand\nDimension\n3\nVertices\n4\n" + corners.encode()
    text += b"Triangles 1\n1 2 4 1\nTetrahedra 1\n1 2 3 4 5\nEnd\n"
    read = read_body(text, ".mesh", ("medit:vertices=1", "medit:triangles=1", "medit:ref=5"), 1.0)
    assert [list(nodes) for nodes in read.sets.values()] == [[0, 2, 3], [0, 1, 3], [0, 1, 2, 3]]
    assert "different nodes in medit:vertices and medit:triangles" in refusal(text, ".mesh", "medit:ref=1")


def unused_points(count: int) -> bytes:
    """A .vtu whose points are zeros, compressed, and of no cell."""
    packed = zlib.compress(bytes(24 * count))
    data = base64.b64encode(struct.pack("<4I", 1, 24 * count, 0, len(packed))) + base64.b64encode(packed)
    head = '<VTKFile type="UnstructuredGrid" byte_order="LittleEndian" compressor="vtkZLibDataCompressor">'
    piece = f'<UnstructuredGrid><Piece NumberOfPoints="{count}" NumberOfCells="0"><Points>'
    array = '<DataArray type="Float64" NumberOfComponents="3" format="binary">'
    return f"{head}{piece}{array}".encode() + data + b"</DataArray></Points></Piece></UnstructuredGrid></VTKFile>"


@pytest.mark.slow
def test_millions_of_unused_points_are_refused_before_they_are_unpacked(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("zlib.decompressobj", lambda: pytest.fail("was unpacked"))
    assert "announces 20000000 points" in refusal(unused_points(20_000_000), ".vtu")


def test_an_array_is_not_unpacked_beyond_what_it_announces() -> None:
    data = unused_points(100_000).replace(b'NumberOfPoints="100000"', b'NumberOfPoints="10"')
    assert "holds more than is announced" in refusal(data, ".vtu")


@pytest.mark.slow
def test_reading_ends_at_its_limits(monkeypatch: pytest.MonkeyPatch) -> None:
    """A reader without end, and one that takes all memory: the process is ended, the sentence says so."""
    monkeypatch.setattr(reading_process, "TIME_S", 1)
    endless = reading_process._START.replace("main(sys.argv[2])", "[0 for _ in iter(int, 1)]")
    monkeypatch.setattr(reading_process, "_START", endless)
    with pytest.raises(MeshFaultError, match="takes longer than 2 s to read"):
        read_apart(b"", ".inp", (), 1.0)


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no limit on the memory of a process")
def test_reading_has_little_memory(monkeypatch: pytest.MonkeyPatch) -> None:
    greedy = (
        "import simcore.mesh.reading_process as p; p.read_body = lambda *a: bytearray(3 * 10**9); p.main(sys.argv[2])"
    )
    start = reading_process._START.replace("from simcore.mesh.reading_process import main; main(sys.argv[2])", greedy)
    monkeypatch.setattr(reading_process, "_START", start)
    with pytest.raises(MeshFaultError, match="takes more than 2000 MB to read"):
        read_apart(b"", ".inp", (), 1.0)


@pytest.mark.slow
def test_the_command_line_reads_in_a_process_of_its_own(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("simcore.mesh.reading.read_body", lambda *a: pytest.fail("was read in this process"))
    mesh = load_mesh(str(FILES / "nset_union.inp"), unit_mm=1.0, names=("Fixed",), sha256=None)
    assert len(mesh.sets["Fixed"]) == 70
    with pytest.raises(ScenarioError, match=r"'Fixd': is not in nset_union\.inp, which has Fixed, Tissue"):
        load_mesh(str(FILES / "nset_union.inp"), unit_mm=1.0, names=("Fixd",), sha256=None)


def mutants(data: bytes, count: int, seed: int) -> Iterator[bytes]:
    """`data` with bytes changed, lines dropped or doubled, or cut off."""
    chance = random.Random(seed)
    for _ in range(count):
        lines, at = data.split(b"\n"), chance.randrange(len(data))
        line = chance.randrange(len(lines))
        yield chance.choice(
            [
                data[:at],
                data[:at] + bytes([chance.randrange(256)]) + data[at + 1 :],
                data[:at] + chance.choice([b"-", b"9999999999999", b"nan", b",", b"\n", b" 1e400 "]) + data[at:],
                b"\n".join(lines[:line] + lines[line + 1 :]),
                b"\n".join([*lines[:line], lines[line], *lines[line:]]),
            ]
        )


@pytest.mark.slow
@pytest.mark.parametrize("name", ["nset_names.inp", "box_groups_saveall.msh", "sphere_v1.0_asc.msh", "tangled.vtu"])
def test_a_changed_file_is_a_mesh_or_one_sentence(name: str) -> None:
    """Bytes changed, doubled and cut off: never another exception than the one with the sentence."""
    data = (FILES / name).read_bytes()
    for changed in mutants(data, count=40, seed=5):
        with contextlib.suppress(MeshFaultError):
            read_body(changed, Path(name).suffix, (), 1.0)
