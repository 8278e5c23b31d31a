"""VTK's XML files of unstructured grids, .vtu: text, base64 or appended, plain or compressed with zlib or LZMA."""

from __future__ import annotations

import base64
import binascii
import lzma
import re
import zlib
from typing import TYPE_CHECKING, Any
from xml.etree import ElementTree

import numpy as np

from simcore.mesh.formats.cursor import parsed
from simcore.mesh.formats.raw import FormatError, RawMesh, check_points
from simcore.mesh.formats.vtk_cells import mesh_of_cells

if TYPE_CHECKING:
    from simcore.arrays import Ints

TYPES = {
    "Int8": "i1", "UInt8": "u1", "Int16": "i2", "UInt16": "u2", "Int32": "i4", "UInt32": "u4", "Int64": "i8",
    "UInt64": "u8", "Float32": "f4", "Float64": "f8",
}  # fmt: skip
COMPRESSORS = {"": None, "vtkZLibDataCompressor": "zlib", "vtkLZMADataCompressor": "lzma"}
HEADERS = {"UInt32": "u4", "UInt64": "u8"}  # types of the sizes before an array
ORDERS = {"LittleEndian": "<", "BigEndian": ">"}
MAXIMUM_CELLS = 8_000_000
LZMA_BYTES = 256 * 2**20  # of its dictionary
_OUT_OF_MEMORY = 1  # expat's code


def read_vtu(data: bytes) -> RawMesh:
    """The mesh in the content of a .vtu file. Raises FormatError."""
    text, appended = _without_appended(data)
    if re.search(rb"<!(DOCTYPE|ENTITY)", text):
        raise _document_type()
    try:
        root = ElementTree.fromstring(text, ElementTree.XMLParser(target=_Builder()))
    except (ElementTree.ParseError, ValueError, LookupError) as error:
        if getattr(error, "code", None) == _OUT_OF_MEMORY:
            raise MemoryError from None
        line = getattr(error, "position", (1, 0))[0]
        raise FormatError(f"line {line}: is not well-formed XML") from None
    if root.tag != "VTKFile" or root.get("type") != "UnstructuredGrid":
        raise FormatError(f"must be a VTKFile of type UnstructuredGrid; it is {root.get('type') or root.tag}"[:200])
    pieces = [p for p in root.iterfind("UnstructuredGrid/Piece") if _count(p, "NumberOfPoints") > 0]
    if len(pieces) != 1:
        raise FormatError(f"must hold one piece with points; it holds {len(pieces)}")
    return _Reader(root, appended).mesh(pieces[0])


def _without_appended(data: bytes) -> tuple[bytes, bytes]:
    """The XML without what is appended, which need not be XML, and the appended bytes behind their underscore."""
    begin = data.find(b"<AppendedData")
    if begin < 0:
        return data, b""
    mark, end = data.find(b"_", data.find(b">", begin)), data.rfind(b"</AppendedData>")
    if mark < 0 or end < mark:
        raise FormatError("has appended data without a beginning or an end")
    return data[:mark] + data[end:], data[mark + 1 : end]


def _count(element: ElementTree.Element, name: str) -> int:
    text = element.get(name, "0")
    if not re.fullmatch(r"\s*[0-9]{1,15}\s*", text):
        raise FormatError(f"has {name}={text[:40]!r}, which is no count")
    return int(text)


def _choice(element: ElementTree.Element, name: str, default: str, choices: dict[str, str]) -> str:
    text = element.get(name, default)
    if text not in choices:
        raise FormatError(f"has {name}={text[:40]!r}; {' and '.join(choices)} are read")
    return choices[text]


class _Builder(ElementTree.TreeBuilder):
    """Of elements; a document type, in whatever encoding, is refused before its entities can be used."""

    def doctype(self, *_declared: str | None) -> None:
        """Raises FormatError."""
        raise _document_type()


def _document_type() -> FormatError:
    return FormatError("declares a document type or entities, which no mesh needs")


class _Reader:
    """Turns DataArray elements into arrays."""

    def __init__(self, root: ElementTree.Element, appended: bytes) -> None:
        self.order = _choice(root, "byte_order", "LittleEndian", ORDERS)
        self.header = np.dtype(self.order + _choice(root, "header_type", "UInt32", HEADERS))
        compressor = root.get("compressor", "")
        if compressor not in COMPRESSORS:
            raise FormatError(f"is compressed with {compressor[:40]!r}; zlib, LZMA and no compression are read")
        self.compression = COMPRESSORS[compressor]
        encoding = root.find("AppendedData")
        self.appended, self.raw = appended, encoding is not None and encoding.get("encoding") == "raw"

    def mesh(self, piece: ElementTree.Element) -> RawMesh:
        """The mesh of a piece."""
        count, cells = _count(piece, "NumberOfPoints"), _count(piece, "NumberOfCells")
        check_points(count)
        if cells > MAXIMUM_CELLS:
            raise FormatError(f"announces {cells} cells, at most {MAXIMUM_CELLS} are read")
        points = self._one(piece, "Points/DataArray", 3 * count).astype(np.float64).reshape(count, 3)
        ends = self._integers(piece, "offsets", cells)
        types = self._integers(piece, "types", cells)
        size = int(ends[-1]) if cells else 0
        if not 0 <= size <= 40 * MAXIMUM_CELLS:
            raise FormatError(f"has cells of {size} nodes in all")
        connectivity = self._integers(piece, "connectivity", size)
        data = [
            (where == "PointData", *array)
            for where, length in (("PointData", count), ("CellData", cells))
            for array in self._named(piece, where, length)
        ]
        return mesh_of_cells(points, connectivity, np.concatenate([[0], ends]), types, data)

    def _integers(self, piece: ElementTree.Element, name: str, count: int) -> Ints:
        values: Ints = self._one(piece, f"Cells/DataArray[@Name='{name}']", count)
        if values.dtype.kind not in "iu":
            raise FormatError(f"has {name} that are not integers")
        return values.astype(np.int64)

    def _named(self, piece: ElementTree.Element, where: str, count: int) -> list[tuple[str, Any]]:
        """The arrays of one number each."""
        return [
            (element.get("Name", "unnamed")[:100], self.values(element, count))
            for element in piece.iterfind(f"{where}/DataArray")
            if element.get("NumberOfComponents", "1") in ("1", "0", "") and element.get("type") in TYPES
        ]

    def _one(self, piece: ElementTree.Element, path: str, count: int) -> Any:
        found = piece.findall(path)
        if len(found) != 1:
            raise FormatError(f"must hold one {path.replace('DataArray', 'array')}; it holds {len(found)}")
        return self.values(found[0], count)

    def values(self, element: ElementTree.Element, count: int) -> Any:
        """`count` numbers. Raises FormatError for any other number of them."""
        name, kind, form = element.get("Name", "Points")[:60], element.get("type", ""), element.get("format", "ascii")
        if kind not in TYPES:
            raise FormatError(f"has the array {name!r} of type {kind[:20]!r}")
        dtype = np.dtype(self.order + TYPES[kind])
        try:
            if form == "ascii":
                values = parsed((element.text or "").encode().split(), dtype.newbyteorder("="))
            else:
                values = np.frombuffer(self._bytes(element, form, count * dtype.itemsize), dtype)
        except binascii.Error:
            raise FormatError(f"has the array {name!r}, which is not in base64") from None
        except (zlib.error, lzma.LZMAError):
            raise FormatError(f"has the array {name!r}, of which a compressed block is damaged") from None
        except ValueError as error:
            raise FormatError(f"has the array {name!r}, which cannot be read: {error}") from None
        if len(values) != count:
            raise FormatError(f"has the array {name!r} with {len(values)} numbers instead of {count}")
        return values.astype(dtype.newbyteorder("="))

    def _bytes(self, element: ElementTree.Element, form: str, size: int) -> bytes:
        """The bytes of an array. Raises ValueError where they are not `size`; no more than one beyond is unpacked."""
        data = self._stored(element, form, size)
        if len(data) != size:
            held = f"more than {size}" if len(data) > size else f"{len(data)}"
            raise ValueError(f"it holds {held} bytes instead of {size}")
        return data

    def _stored(self, element: ElementTree.Element, form: str, size: int) -> bytes:
        if form == "binary":
            return self._decoded("".join((element.text or "").split()).encode(), size, raw=False)
        if form != "appended":
            raise ValueError(f"its format is {form[:20]!r}")
        offset = _count(element, "offset")
        return self._decoded(self.appended[offset:], size, raw=self.raw)

    def _decoded(self, data: bytes, size: int, *, raw: bool) -> bytes:
        width = self.header.itemsize
        if self.compression is None:
            length = int(np.frombuffer(_taken(data, 0, width, raw=raw), self.header)[0])
            return _taken(data, 0, width + min(length, size + 1), raw=raw)[width:]
        blocks = int(np.frombuffer(_taken(data, 0, width, raw=raw), self.header)[0])
        if blocks > max(size, 1):
            raise ValueError(f"{blocks} compressed blocks are announced")
        head = width * (3 + blocks)
        sizes = np.frombuffer(_taken(data, 0, head, raw=raw), self.header)[3:].astype(np.int64)
        start = head if raw else 4 * -(-head // 3)  # in base64 the header is a text of its own
        if (sizes < 0).any() or sizes.sum() > len(data):
            raise ValueError("the compressed blocks are cut off")
        packed = _taken(data, start, int(sizes.sum()), raw=raw)
        return self._unpacked(packed, sizes, size)

    def _unpacked(self, packed: bytes, sizes: Ints, size: int) -> bytes:
        out, at = bytearray(), 0
        for length in sizes:
            block = packed[at : at + length]
            at += int(length)
            opened: Any = zlib.decompressobj() if self.compression == "zlib" else _lzma()
            out += opened.decompress(block, size + 1 - len(out))
            if not opened.eof or len(out) > size:
                raise ValueError("a compressed block is cut off or holds more than is announced")
        return bytes(out)


def _lzma() -> lzma.LZMADecompressor:
    """With little memory: a header of a few bytes may ask for gigabytes."""
    return lzma.LZMADecompressor(memlimit=LZMA_BYTES)


def _taken(data: bytes, start: int, length: int, *, raw: bool) -> bytes:
    """`length` bytes, which begin at the character `start`."""
    if raw:
        taken = data[start : start + length]
    else:
        text = data[start : start + 4 * -(-length // 3)]
        taken = base64.b64decode(text, validate=True)[:length]
    if len(taken) < length:
        raise ValueError(f"{length} bytes are announced, {len(taken)} are there")
    return taken
