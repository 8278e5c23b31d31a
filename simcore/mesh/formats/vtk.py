"""VTK's older files of unstructured grids, .vtk: text or bytes, with cells as before and since version 5."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Any

import numpy as np

from simcore.mesh.formats.cursor import BinaryCursor, TextCursor, as_text, integer
from simcore.mesh.formats.raw import FormatError, RawMesh, check_points
from simcore.mesh.formats.vtk_cells import mesh_of_cells
from simcore.mesh.formats.vtu import read_vtu

if TYPE_CHECKING:
    from simcore.arrays import Floats, Ints

TYPES = {
    "char": "i1", "signed_char": "i1", "unsigned_char": "u1", "short": "i2", "unsigned_short": "u2", "int": "i4",
    "unsigned_int": "u4", "long": "i8", "unsigned_long": "u8", "vtktypeint64": "i8", "vtktypeuint64": "u8",
    "vtkidtype": "i4", "float": "f4", "double": "f8",
}  # fmt: skip
WIDTHS = {"VECTORS": 3, "NORMALS": 3, "TENSORS": 9, "TENSORS6": 6, "GLOBAL_IDS": 1, "PEDIGREE_IDS": 1}


def read_vtk(data: bytes) -> RawMesh:
    """The mesh in the content of a .vtk file, also where that is XML. Raises FormatError."""
    if data.lstrip().startswith(b"<"):
        return read_vtu(data)
    lines = data.split(b"\n", 3)
    if not lines[0].startswith(b"# vtk DataFile Version") or len(lines) < 4:
        raise FormatError("line 1: is not '# vtk DataFile Version', with which a .vtk file begins")
    form = lines[2].strip().upper()
    if form not in (b"ASCII", b"BINARY"):
        raise FormatError("line 3: is neither ASCII nor BINARY")
    body = sum(len(line) + 1 for line in lines[:3])
    if form == b"BINARY":
        cursor = BinaryCursor(data, ">")
        cursor.at = body
        return _Reader(cursor).mesh()
    text = TextCursor(b"\n\n\n" + data[body:])  # the numbers of the lines are those of the file
    return _Reader(text).mesh()


class _Reader:
    """Reads section after section."""

    def __init__(self, cursor: TextCursor | BinaryCursor) -> None:
        self.cursor = cursor
        self.points: Floats | None = None
        self.connectivity = self.offsets = self.types = np.zeros(0, np.int64)
        self.data: list[tuple[bool, str, Any]] = []
        self.sections = set[str]()  # those that come once, as far as they came
        self.place = ""  # POINT_DATA or CELL_DATA
        self.count = 0

    def mesh(self) -> RawMesh:
        """The mesh. Raises FormatError."""
        while not self.cursor.at_end:
            words = self._words()
            self._section(words[0].upper(), words)
        if self.points is None:
            raise FormatError("has no POINTS")
        return mesh_of_cells(self.points, self.connectivity, self.offsets, self.types, self.data)

    def _words(self) -> list[str]:
        """Those of the next line, at least one."""
        line = self.cursor.line()
        return line.split() or [line]

    def _section(self, name: str, words: list[str]) -> None:
        if name in self.sections:
            raise self.cursor.fault(f"{name} comes a second time")
        if name in ("DATASET", "POINTS", "CELLS", "CELL_TYPES"):
            self.sections.add(name)
        if name == "DATASET":
            if words[1:] != ["UNSTRUCTURED_GRID"]:
                raise self.cursor.fault(f"must be a grid of type UNSTRUCTURED_GRID; it is {' '.join(words[1:])[:40]}")
        elif name == "POINTS":
            count = self._number(words, 1)
            check_points(count)
            self.points = self._values(words, 2, 3 * count).astype(np.float64).reshape(count, 3)
        elif name == "CELLS":
            self._cells(self._number(words, 1), self._number(words, 2))
        elif name == "CELL_TYPES":
            self.types = self.cursor.numbers(self._number(words, 1), np.int32).astype(np.int64)
        else:
            self._data_section(name, words)

    def _data_section(self, name: str, words: list[str]) -> None:
        if name in ("POINT_DATA", "CELL_DATA"):
            self.place, self.count = name, self._number(words, 1)
        elif name == "METADATA":
            self._skip_metadata()
        elif name == "FIELD":
            self._field(words)
        elif name == "SCALARS":
            self._scalars(words)
        elif name in WIDTHS:
            self._keep(self._name(words), WIDTHS[name], self._values(words, 2, WIDTHS[name] * self.count))
        elif name == "LOOKUP_TABLE":
            size, kind = self._number(words, 2), np.float32 if isinstance(self.cursor, TextCursor) else np.uint8
            self.cursor.numbers(4 * size, kind)
        else:
            raise self.cursor.fault(f"{' '.join(words)[:40]!r} begins no section that is read")

    def _cells(self, count: int, size: int) -> None:
        line = self.cursor.line() if isinstance(self.cursor, TextCursor) else self._peeked()
        if line.startswith("OFFSETS"):
            offsets = self._integers(line.split(), count)
            line = self.cursor.line()
            if not line.startswith("CONNECTIVITY"):
                raise self.cursor.fault("must be CONNECTIVITY")
            self.offsets, self.connectivity = offsets, self._integers(line.split(), size)
            return
        if isinstance(self.cursor, TextCursor):
            self.cursor.put_back(line)
        self._counted_cells(self.cursor.numbers(size, np.int32).astype(np.int64), count)

    def _counted_cells(self, numbers: Ints, count: int) -> None:
        """Of each cell the count of its nodes, then they."""
        if count > len(numbers):
            raise self.cursor.fault(f"{count} cells are announced with {len(numbers)} numbers in all")
        starts, at = np.zeros(count, np.int64), 0
        for cell in range(count):
            if at >= len(numbers) or numbers[at] < 0:
                raise self.cursor.fault("the cells do not fit their announced size")
            starts[cell] = at
            at += 1 + int(numbers[at])
        if at != len(numbers):
            raise self.cursor.fault("the cells do not fit their announced size")
        heads = np.zeros(len(numbers), bool)
        heads[starts] = True
        self.connectivity = numbers[~heads]
        self.offsets = np.concatenate([[0], np.cumsum(numbers[starts])])

    def _peeked(self) -> str:
        """OFFSETS and its line where the cells are written as since version 5; else nothing is taken."""
        assert isinstance(self.cursor, BinaryCursor)
        start = self.cursor.at
        if self.cursor.data[start : start + 200].lstrip().startswith(b"OFFSETS"):
            return self.cursor.line()
        return ""

    def _scalars(self, words: list[str]) -> None:
        width = self._number(words, 3) if len(words) > 3 else 1
        if not 1 <= width <= 4:
            raise self.cursor.fault(f"SCALARS have 1 to 4 components, not {width}")
        if not self.cursor.line().startswith("LOOKUP_TABLE"):
            raise self.cursor.fault("must be LOOKUP_TABLE")
        self._keep(self._name(words), width, self._values(words, 2, width * self.count))

    def _field(self, words: list[str]) -> None:
        for _ in range(self._number(words, 2)):
            head = self._words()
            while head[0] == "METADATA":
                self._skip_metadata()
                head = self._words()
            width, count = self._number(head, 1), self._number(head, 2)
            values = self._values(head, 3, width * count)
            if self.place and count == self.count:
                self._keep(head[0], width, values)

    def _keep(self, name: str, width: int, values: Any) -> None:
        if width == 1 and self.place:
            self.data.append((self.place == "POINT_DATA", _unquoted(name)[:100], values))

    def _skip_metadata(self) -> None:
        """To the empty line at its end."""
        if isinstance(self.cursor, BinaryCursor):
            self.cursor.skip_past(b"\n\n", "the empty line that ends METADATA")
        else:
            self.cursor.skip_to_empty_line()

    def _name(self, words: list[str]) -> str:
        if len(words) < 2:
            raise self.cursor.fault(f"{words[0][:40]!r} lacks a name")
        return words[1]

    def _integers(self, words: list[str], count: int) -> Ints:
        """Of the type that stands behind the first word."""
        kind = words[1].lower() if len(words) > 1 else ""
        if TYPES.get(kind, "i")[0] == "f":
            raise self.cursor.fault(f"{words[0]} of type {kind!r} are not integers")
        values: Ints = self._values(words, 1, count).astype(np.int64)
        return values

    def _number(self, words: list[str], place: int) -> int:
        if place >= len(words):
            raise self.cursor.fault(f"{' '.join(words)[:40]!r} lacks a number")
        number = integer(self.cursor, words[place])
        if number < 0:
            raise self.cursor.fault(f"{number} is not a count")
        return number

    def _values(self, words: list[str], place: int, count: int) -> Any:
        kind = words[place].lower() if place < len(words) else ""
        if kind == "bit" or kind not in TYPES:
            raise self.cursor.fault(f"numbers of type {kind[:20]!r} are not read")
        return self.cursor.numbers(count, TYPES[kind])


def _unquoted(name: str) -> str:
    """A name as it was before VTK wrote %20 for a blank."""
    octets = re.sub(rb"%([0-9A-Fa-f]{2})", lambda match: bytes([int(match[1], 16)]), name.encode())
    return as_text(octets)
