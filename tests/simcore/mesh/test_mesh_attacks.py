"""Mesh files made to mislead a reader: each is read right, or refused in one line with the reader's own reason."""

from __future__ import annotations

import base64
import lzma
import struct

import numpy as np
import pytest

from simcore.mesh import reading_process
from simcore.mesh.reading import MeshFaultError, read_body
from simcore.mesh.reading_process import read_apart

POINTS = [(0, 0, 0), (20, 0, 0), (0, 20, 0), (0, 0, 20), (20, 20, 20)]
CORNERS = "\n".join(" ".join(map(str, point)) for point in POINTS)


def refused(data: bytes | str, suffix: str, *sets: str) -> str:
    """The sentence, which is one line without control characters."""
    with pytest.raises(MeshFaultError) as caught:
        read_body(data if isinstance(data, bytes) else data.encode(), suffix, sets, 1.0)
    assert caught.value.message.isprintable()
    return caught.value.message


def nodes(data: bytes | str, suffix: str, name: str) -> list[int]:
    read = read_body(data if isinstance(data, bytes) else data.encode(), suffix, (name,), 1.0)
    assert (len(read.points), len(read.tets)) == (5, 2)
    return [int(node) for node in read.sets[name]]


# .vtu

VTU = (
    '<VTKFile type="UnstructuredGrid" byte_order="LittleEndian"><UnstructuredGrid>'
    '<Piece NumberOfPoints="5" NumberOfCells="2"><Points>'
    f'<DataArray type="Float64" NumberOfComponents="3" format="ascii">{CORNERS}</DataArray></Points><Cells>'
    '<DataArray type="UInt8" Name="connectivity" format="ascii">0 1 2 3 1 2 3 4</DataArray>'
    '<DataArray type="Int64" Name="offsets" format="ascii">4 8</DataArray>'
    '<DataArray type="UInt8" Name="types" format="ascii">10 10</DataArray></Cells>'
    '<PointData><DataArray type="Int32" Name="ribs" format="ascii">1 0 0 0 1</DataArray></PointData>'
    "</Piece></UnstructuredGrid></VTKFile>"
)


def with_points(content: bytes, form: str = "binary", attributes: str = "") -> str:
    """The points in base64, and attributes of the file."""
    text = base64.encodebytes(content).decode()  # with line ends
    array = f'<DataArray type="Float64" NumberOfComponents="3" format="{form}">{text}</DataArray>'
    plain = VTU[VTU.index("<Points>") + 8 : VTU.index("</Points>")]
    return VTU.replace(plain, array).replace('byte_order="LittleEndian"', f'byte_order="LittleEndian" {attributes}')


RAW_POINTS = np.array(POINTS, "<f8").tobytes()


def test_base64_may_be_broken_into_lines() -> None:
    assert nodes(with_points(struct.pack("<I", 120) + RAW_POINTS), ".vtu", "ribs=1") == [0, 4]


def greedy_lzma() -> str:
    """A header that asks for a dictionary of 4 GB."""
    packed = bytearray(lzma.compress(RAW_POINTS, format=lzma.FORMAT_ALONE))
    packed[1:5] = b"\xff" * 4
    head = base64.b64encode(struct.pack("<4I", 1, 120, 0, len(packed))).decode()
    text = with_points(b"@", attributes='compressor="vtkLZMADataCompressor"')
    return text.replace("QA==\n", head + base64.b64encode(packed).decode())


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (greedy_lzma(), "'Points', of which a compressed block is damaged"),
        (with_points(struct.pack("<I", 20) + RAW_POINTS), "it holds 20 bytes instead of 120"),
        (with_points(struct.pack("<I", 121) + RAW_POINTS + b"x"), "it holds more than 120 bytes"),
        (with_points(struct.pack("<b", 120) + RAW_POINTS, attributes='header_type="Int8"'), "has header_type='Int8'"),
        (VTU.replace("LittleEndian", "PDP"), "has byte_order='PDP'"),
        (VTU.replace("3 4<", "3 300<"), "'300' is not an integer from 0 to 255"),
        (VTU.replace("3 4<", "3 255<"), "a tetrahedron with node 255"),
        (VTU.replace("3 4<", "3 0_4<"), "'0_4' is not an integer"),
        (VTU.replace("3 4<", "3 \u0664<"), "'\u0664' is not an integer"),
        (VTU.replace('Points="5"', 'Points="\u0665"'), "NumberOfPoints='\u0665', which is no count"),
        (VTU.replace("</Cells>", f"</Cells><a>{'<b>' * 50_000}{'</b>' * 50_000}</a>").replace("</VTK", "<"), "XML"),
        ('<VTKFile type="a&#10;b&#x202e;c"/>', r"it is a\nb\u202ec"),
    ],
)
def test_a_vtu_that_misleads_is_refused(data: str, words: str) -> None:
    assert words in refused(data, ".vtu")


def test_a_document_type_is_refused_in_any_encoding() -> None:
    """In UTF-16 its letters are not those that a search of bytes would find."""
    head = '<?xml version="1.0" encoding="utf-16"?>'
    assert nodes((head + VTU).encode("utf-16"), ".vtu", "ribs=1") == [0, 4]
    for entity in ('"1"', 'SYSTEM "file:///etc/hostname"'):
        declared = f"{head}<!DOCTYPE x [<!ENTITY a {entity}>]>{VTU.replace('>1 0 0', '>&a; 0 0')}"
        assert "declares a document type" in refused(declared.encode("utf-16"), ".vtu", "ribs")


def test_offsets_that_run_round_the_integers_are_refused() -> None:
    """Polygons of 2^62 nodes lead the offsets past the largest integer and back to 4."""
    rows = [2**62, 2**62 + 4, -(2**62), 4, 8]
    text = VTU.replace(">4 8<", f">{' '.join(map(str, rows))}<").replace(">10 10<", ">7 10 7 7 10<")
    assert "offsets are not from 0 to 8" in refused(text.replace('Cells="2"', 'Cells="5"'), ".vtu")


def test_two_arrays_of_one_name_are_no_set() -> None:
    other = '<DataArray type="Int32" Name="ribs" format="ascii">0 1 0 0 0</DataArray></PointData>'
    text = VTU.replace("</PointData>", other)
    for name in ("ribs", "ribs=1"):
        assert "is the name of two arrays" in refused(text, ".vtu", name)


@pytest.mark.parametrize("name", ["ribs=--1", "ribs=\u0661", "ribs=1_0"])
def test_what_is_no_number_of_an_array_is_an_unknown_name(name: str) -> None:
    assert "is not in FILE, which has ribs=NUMBER" in refused(VTU, ".vtu", name)


@pytest.mark.parametrize(
    ("far", "words"),
    [("1e300", "each edge must be"), ("1e308", "each edge must be"), ("-1e400", "not finite"), ("nan", "not finite")],
)
@pytest.mark.filterwarnings("error")
def test_points_beyond_all_numbers_are_refused_without_a_warning(far: str, words: str) -> None:
    assert words in refused(VTU.replace(">0 0 0\n", f">{far} 0 0\n"), ".vtu")


# .vtk


def vtk(
    cells: str = "CELLS 2 10\n4 0 1 2 3\n4 1 2 3 4\n", tail: str = "", count: str = "5", types: str = "10 10"
) -> str:
    head = "# vtk DataFile Version 3.0\nt\nASCII\nDATASET UNSTRUCTURED_GRID\n"
    return f"{head}POINTS {count} float\n{CORNERS}\n{cells}CELL_TYPES {len(types.split())}\n{types}\n{tail}"


def of_bytes(tail: bytes) -> bytes:
    cells = np.array([4, 0, 1, 2, 3, 4, 1, 2, 3, 4], ">i4").tobytes()
    head = b"# vtk DataFile Version 3.0\nt\nBINARY\nDATASET UNSTRUCTURED_GRID\nPOINTS 5 float\n"
    points, types = np.array(POINTS, ">f4").tobytes(), np.array([10, 10], ">i4").tobytes()
    return head + points + b"\nCELLS 2 10\n" + cells + b"\nCELL_TYPES 2\n" + types + b"\n" + tail


NEWER = "CELLS 3 8\nOFFSETS {0}\n0 4 8\nCONNECTIVITY {0}\n0 1 2 3 1 2 3 {1}\n"


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (vtk(tail="VECTORS"), "line 16: 'VECTORS' lacks a name"),
        (vtk(tail="\x1c"), r"line 16: '\x1c' begins no section"),
        (vtk(tail="\xa0"), r"line 16: '\xa0' begins no section"),
        (vtk(tail="POINT_DATA 5\nFIELD f 1\n\x1c"), r"line 18: '\x1c' lacks a number"),
        (vtk(tail="CELL_DATA 1\nSCALARS r int\nLOOKUP_TABLE default\n1"), "'r' with 1 numbers for 2 cells"),
        (vtk(tail="POINT_DATA 3\nSCALARS r int\nLOOKUP_TABLE default\n1 0 1"), "'r' with 3 numbers for 5 points"),
        (vtk(tail="POINT_DATA 5\nSCALARS r int 9\nLOOKUP_TABLE default\n1 0 1 0 0"), "SCALARS have 1 to 4 components"),
        (
            vtk(tail="POINT_DATA 5\nSCALARS r int\nLOOKUP_TABLE default\n1 0 1 0 1_0"),
            "line 19: '1_0' is not an integer",
        ),
        (vtk(tail=f"POINTS 5 float\n{CORNERS}\n"), "line 16: POINTS comes a second time"),
        (vtk(tail="CELLS 1 5\n4 0 1 2 3\n"), "line 16: CELLS comes a second time"),
        (vtk(count="--5"), "line 5: '--5' is not an integer"),
        (vtk(count="\u0665"), "line 5: '\u0665' is not an integer"),
        (vtk("CELLS 99999999999 4\n4 0 1 2 3\n"), "line 12: 99999999999 cells are announced with 4 numbers"),
        (vtk("CELLS 99999999999999999999999 4\n"), "line 11: 99999999999999999999999 is too large an integer"),
        (vtk(NEWER.format("double", "4.5")), "OFFSETS of type 'double' are not integers"),
        (of_bytes(b" " * 150_000 + b"garbage"), "'garbage' begins no section"),
        (of_bytes(b"METADATA\nINFORMATION 0\n"), "the empty line that ends METADATA is missing"),
    ],
)
def test_a_vtk_that_misleads_is_refused(data: bytes | str, words: str) -> None:
    assert words in refused(data, ".vtk")


def test_metadata_and_other_cells_beside_the_tetrahedra() -> None:
    array = "POINT_DATA 5\nFIELD f 1\nr 1 5 int\n1 0 0 0 0\nMETADATA\nINFORMATION 1\nNAME L LOCATION v\n\n"
    mixed = "CELLS 5 17\n4 0 1 2 3\n4 1 2 3 4\n3 0 1 2\n1 0\n0\n"
    assert nodes(vtk(tail=array), ".vtk", "r=1") == [0]
    assert nodes(vtk(NEWER.format("vtktypeint64", 4), array), ".vtk", "r=1") == [0]
    assert nodes(vtk(mixed, array, types="10 10 5 1 0"), ".vtk", "r=1") == [0]
    assert "has a triangle of 4 nodes" in refused(vtk(mixed, types="10 5 10 1 0"), ".vtk")


# Gmsh


def gmsh2(elements: str = "1 4 2 7 1 1 2 3 4\n2 4 2 7 1 2 3 4 5\n", names: str = "", data: str = "") -> str:
    numbered = "\n".join(f"{i + 1} {x} {y} {z}" for i, (x, y, z) in enumerate(POINTS))
    head = f"$MeshFormat\n2.2 0 8\n$EndMeshFormat\n{names}$Nodes\n5\n{numbered}\n$EndNodes\n"
    return f"{head}$Elements\n2\n{elements}$EndElements\n{data}"


def gmsh4(
    entities: str = "0 0 0 1\n1 0 0 0 20 20 20 1 7 0\n",
    block: str = "3 1 4 2",
    names: str = '$PhysicalNames\n1\n3 7 "liver"\n$EndPhysicalNames\n',
) -> str:
    head = f"$MeshFormat\n4.1 0 8\n$EndMeshFormat\n{names}$Entities\n{entities}$EndEntities\n"
    points = f"$Nodes\n1 5 1 5\n3 1 0 5\n1\n2\n3\n4\n5\n{CORNERS}\n$EndNodes\n"
    return f"{head}{points}$Elements\n1 2 1 2\n{block}\n1 1 2 3 4\n2 2 3 4 5\n$EndElements\n"


def node_data(*rows: str, count: int | None = None, name: str = "r", kind: str = "Node") -> str:
    total = len(rows) if count is None else count
    return "\n".join([f'${kind}Data\n1\n"{name}"\n1\n0\n3\n0\n1\n{total}', *rows, f"$End{kind}Data", ""])


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (
            gmsh2("1 4 2 7 1 1 2 3 4\n2 4 2 7 1 2 3 4 9999999999999999999999999\n"),
            "line 15: 9999999999999999999999999 is",
        ),
        (gmsh2("1 4 2 99999999999999999999 1 1 2 3 4\n"), "line 14: 99999999999999999999 is too large"),
        (gmsh2("1 4 2 7 1 1 2 3 +-4\n"), "line 14: '+-4' is not an integer"),
        (gmsh2("1 4 2 7 1 1 2 3 \u0664\n"), "line 14: '\u0664' is not an integer"),
        (gmsh2(names='$PhysicalNames\n1\n3 \u0667 "a"\n$EndPhysicalNames\n'), "line 6: is no physical name"),
        (gmsh2(data=node_data().replace("\n0\n$End", "\n\x1c0\n$End")), r"'\x1c0' is not an integer"),
        (gmsh2(data=node_data(count=-3)), "-3 is not a count"),
        (gmsh2(data=node_data("1 1", "1 0")), "'r' that give two values to one of the nodes"),
        (gmsh4(block="2 1 4 2"), "line 30: an entity of dimension 2 cannot have elements of the kind tetrahedron"),
        (gmsh4("0 0 0 2\n1 0 0 0 9 9 9 1 7 0\n1 0 0 0 9 9 9 1 8 0\n"), "line 11: entity 1 of dimension 3 is defined a"),
        (gmsh4() + "$Entities\n0 0 0 1\n1 0 0 0 9 9 9 1 8 0\n$EndEntities\n", "$Entities must come once, before"),
    ],
)
def test_a_gmsh_file_that_misleads_is_refused(data: str, words: str) -> None:
    assert words in refused(data, ".msh")


def test_two_steps_of_data_are_no_set_and_names_keep_their_blanks() -> None:
    steps = node_data("1 1", "2 0") + node_data("1 0", "5 1")
    assert "is the name of two arrays" in refused(gmsh2(data=steps), ".msh", "r=1")
    assert nodes(gmsh4(names='$PhysicalNames\n1\n3 7 "a  b"\n$EndPhysicalNames\n'), ".msh", "a  b") == [0, 1, 2, 3, 4]


def test_data_of_nothing_in_the_file_are_a_remark() -> None:
    text = gmsh2(data=node_data("1 1", "9 1", kind="Element"))
    read = read_body(text.encode(), ".msh", ("r",), 1.0)
    assert read.remarks == ("1 numbers of 'r' are left out: their elements are not in the file",)
    assert list(read.sets["r"]) == [0, 1, 2, 3]


def test_a_name_cannot_act_upon_a_terminal_or_a_page() -> None:
    names = '$PhysicalNames\n1\n3 7 "a\u202e\x1b[31mb"\n$EndPhysicalNames\n'
    assert r"a\u202e\x1b[31mb" in refused(gmsh2(names=names), ".msh", "unknown")


# .mesh


def medit(tetrahedra: str) -> str:
    corners = "".join(f"{x} {y} {z} 1\n" for x, y, z in POINTS)
    return f"MeshVersionFormatted 2\nDimension 3\nVertices\n5\n{corners}Tetrahedra\n{tetrahedra}End\n"


@pytest.mark.parametrize(
    ("tetrahedra", "words"),
    [
        ("--1\n", "line 11: '--1' is not an integer"),
        ("\u0662\n1 2 3 4 1\n2 3 4 5 1\n", "line 11: '\u0662' is not an integer"),
        ("2\n1 2 3 4 1\n2 3 4 0_5 1\n", "line 13: '0_5' is not an integer"),
        ("2\n1 2 3 4 1\n2 3 4 0 1\n", "a tetrahedron with node 0; its points are 1 to 5"),
        ("0\n", "must hold tetrahedra; it holds no cells"),
    ],
)
def test_a_medit_file_that_misleads_is_refused(tetrahedra: str, words: str) -> None:
    assert words in refused(medit(tetrahedra), ".mesh")


# whatever else a reader may stumble over


@pytest.mark.slow
def test_a_reader_that_breaks_is_not_called_slow(monkeypatch: pytest.MonkeyPatch) -> None:
    broken = "import simcore.mesh.reading_process as p; p.read_body = lambda *a: {}[sys.argv]; p.main(sys.argv[2])"
    start = reading_process._START.replace("from simcore.mesh.reading_process import main; main(sys.argv[2])", broken)
    monkeypatch.setattr(reading_process, "_START", start)
    with pytest.raises(MeshFaultError, match=r"stopped at something unforeseen \(TypeError\)"):
        read_apart(b"", ".inp", (), 1.0)
