"""The sections of Gmsh's formats 2 and 4."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

import numpy as np

from simcore.mesh.formats.cursor import BinaryCursor, TextCursor, integer
from simcore.mesh.formats.gmsh_content import ELEMENTS, Content, Elements, count_line
from simcore.mesh.formats.gmsh_old import read_elements, read_nodes
from simcore.mesh.formats.raw import CellBlock, check_points, integers

if TYPE_CHECKING:
    from simcore.arrays import Ints

_NAME = re.compile(r'([0-9]+)\s+(-?[0-9]+)\s+"(.*)"')


def read_sections(cursor: TextCursor | BinaryCursor, version: str, size: int) -> Content:
    """All sections from the cursor on. version: 2, 4.0 or 4.1. size: bytes of a size. Raises FormatError."""
    content, kinds = Content(), _Kinds(version, np.uint64 if size == 8 else np.uint32)
    while not cursor.at_end:
        section = cursor.line()
        if not section.startswith("$"):
            raise cursor.fault(f"{section[:40]!r} begins no section")
        name = section[1:]
        if name in ("PartitionedEntities", "GhostElements"):
            raise cursor.fault("the mesh is partitioned, which is not read: save it in one part")
        if name == "PhysicalNames":
            _read_names(cursor, content)
        elif name == "Entities" and version != "2":
            _read_entities(cursor, content, kinds)
        elif name == "Nodes":
            (read_nodes if version == "2" else kinds.read_nodes)(cursor, content)
        elif name == "Elements":
            (read_elements if version == "2" else kinds.read_elements)(cursor, content)
        elif name in ("NodeData", "ElementData"):
            _read_data(cursor, content, at_nodes=name == "NodeData")
        else:
            _skip(cursor, name)
            continue
        if cursor.line() != f"$End{name}":
            raise cursor.fault(f"must be $End{name}")
    return content


def _skip(cursor: TextCursor | BinaryCursor, name: str) -> None:
    if isinstance(cursor, BinaryCursor):
        cursor.skip_past(f"$End{name}".encode())
        return
    while cursor.line() != f"$End{name}":
        pass


def _read_names(cursor: TextCursor | BinaryCursor, content: Content) -> None:
    for _ in range(count_line(cursor)):
        line = cursor.line()
        match = _NAME.fullmatch(line)
        if match is None:
            raise cursor.fault('is no physical name: dimension, number, "name"')
        content.names.append((integer(cursor, match[1]), integer(cursor, match[2]), match[3]))


class _Kinds:
    """What formats 4.0 and 4.1 do differently, and the type of a size."""

    def __init__(self, version: str, size: type[np.unsignedinteger]) -> None:
        self.newer, self.size = version == "4.1", size

    def sizes(self, cursor: TextCursor | BinaryCursor, count: int) -> list[int]:
        """`count` sizes."""
        return [int(n) for n in cursor.numbers(count, self.size)]

    def read_nodes(self, cursor: TextCursor | BinaryCursor, content: Content) -> None:
        """Blocks of the nodes of one entity each."""
        blocks, total = self.sizes(cursor, 4 if self.newer else 2)[:2]
        check_points(total)
        for _ in range(blocks):
            dimension, _entity, parametric, count = self._block(cursor)
            check_points(count)
            if not 0 <= dimension <= 3 or parametric not in (0, 1):
                raise cursor.fault("is no head of a block of nodes")
            width = 3 + (dimension if parametric else 0)
            if self.newer:
                numbers = cursor.numbers(count, self.size)
                points = cursor.numbers(count * width, np.float64).reshape(count, width)
            else:
                rows = cursor.numbers(count * (1 + width), np.float64).reshape(count, 1 + width)
                numbers, points = rows[:, 0], rows[:, 1:]
            content.add_nodes(numbers, points[:, :3])
        if sum(len(block) for block in content.numbers) != total:
            raise cursor.fault(f"{total} nodes were announced, the blocks hold another number")

    def read_elements(self, cursor: TextCursor | BinaryCursor, content: Content) -> None:
        """Blocks of the elements of one entity and type each; the groups are those of the entity."""
        blocks, total = self.sizes(cursor, 4 if self.newer else 2)[:2]
        for _ in range(blocks):
            of, entity, kind, count = self._block(cursor)
            if kind not in ELEMENTS:
                raise cursor.fault(f"elements of Gmsh's type {kind} are not known")
            width = 1 + ELEMENTS[kind][1]
            dtype = self.size if self.newer else np.int32
            rows = cursor.numbers(count * width, dtype).astype(np.int64).reshape(count, width)
            block = CellBlock(ELEMENTS[kind][0], rows)
            if (dimension := block.dimension) != of:
                raise cursor.fault(f"an entity of dimension {of} cannot have elements of the kind {block.name}")
            groups = content.entity_groups.get((dimension, entity), ())
            content.elements.append(Elements(kind, rows[:, 0], rows[:, 1:], groups))
        if sum(len(block.numbers) for block in content.elements) != total:
            raise cursor.fault(f"{total} elements were announced, the blocks hold another number")

    def _block(self, cursor: TextCursor | BinaryCursor) -> tuple[int, int, int, int]:
        """Dimension, entity, whether nodes are parametric or the type of elements, count."""
        first, second, third = (int(n) for n in cursor.numbers(3, np.int32))
        (count,) = self.sizes(cursor, 1)
        if not self.newer:  # entity before dimension
            first, second = second, first
        return first, second, third, count


def _read_entities(cursor: TextCursor | BinaryCursor, content: Content, kinds: _Kinds) -> None:
    """Of each: number, place, physical groups, and what bounds it."""
    if content.elements or content.entity_groups:
        raise cursor.fault("$Entities must come once, before $Elements")
    for dimension, count in enumerate(kinds.sizes(cursor, 4)):
        for _ in range(count):
            (entity,) = (int(n) for n in cursor.numbers(1, np.int32))
            cursor.numbers(3 if dimension == 0 and kinds.newer else 6, np.float64)
            groups = _groups(cursor, kinds)
            if dimension > 0:
                _groups(cursor, kinds)  # what bounds it is written in the same way
            if (dimension, entity) in content.entity_groups:
                raise cursor.fault(f"entity {entity} of dimension {dimension} is defined a second time")
            content.entity_groups[dimension, entity] = tuple(sorted({abs(int(g)) for g in groups}))


def _groups(cursor: TextCursor | BinaryCursor, kinds: _Kinds) -> Ints:
    (count,) = kinds.sizes(cursor, 1)
    groups: Ints = cursor.numbers(count, np.int32)
    return groups


def _read_data(cursor: TextCursor | BinaryCursor, content: Content, *, at_nodes: bool) -> None:
    """Text, real and integer tags, then a number and values of each; what has one value is kept."""
    texts = [cursor.line().strip('"') for _ in range(count_line(cursor))]
    for _ in range(count_line(cursor)):
        cursor.line()
    tags = [integer(cursor, cursor.line()) for _ in range(count_line(cursor))]
    if not texts or len(tags) < 3 or tags[1] not in (1, 3, 9):
        raise cursor.fault("the data need a name, and a step, a number of components (1, 3 or 9) and a count")
    width, count = tags[1], tags[2]
    if count < 0:
        raise cursor.fault(f"{count} is not a count")
    if isinstance(cursor, TextCursor):
        rows = cursor.numbers(count * (1 + width), np.float64).reshape(count, 1 + width)
        numbers, values = rows[:, 0], rows[:, 1:]
    else:
        packed = cursor.numbers(count * (4 + 8 * width), np.uint8).tobytes()
        kind = np.dtype([("number", f"{cursor.order}i4"), ("values", f"{cursor.order}f8", width)])
        table = np.frombuffer(packed, kind)
        numbers, values = table["number"], table["values"].reshape(count, width)
    if width == 1:
        content.data.append((texts[0], at_nodes, integers(numbers), values[:, 0].astype(np.float64)))
