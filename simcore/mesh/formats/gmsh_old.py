"""Nodes and elements as Gmsh wrote them in its formats 1 and 2, one element a line; format 2 in bytes too."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from simcore.mesh.formats.cursor import BinaryCursor, TextCursor, integer
from simcore.mesh.formats.gmsh_content import ELEMENTS, Content, Elements, count_line, grouped
from simcore.mesh.formats.raw import check_points

if TYPE_CHECKING:
    from simcore.arrays import Ints


def read_first_format(cursor: TextCursor) -> Content:
    """The sections $NOD and $ELM."""
    content = Content()
    content.repeats = True
    while not cursor.at_end:
        section = cursor.line()
        if section == "$NOD":
            read_nodes(cursor, content)
        elif section == "$ELM":
            rows = [_first_format_row(cursor) for _ in range(count_line(cursor))]
            content.elements += grouped(rows, cursor.fault)
        else:
            raise cursor.fault(f"{section[:40]!r} begins no section of Gmsh's format 1")
        end = section.replace("$", "$END")
        if cursor.line() != end:
            raise cursor.fault(f"must be {end}")
    return content


def read_nodes(cursor: TextCursor | BinaryCursor, content: Content) -> None:
    """A count, then number, x, y, z of each."""
    count = count_line(cursor)
    check_points(count)
    if isinstance(cursor, TextCursor):
        rows = cursor.numbers(4 * count, np.float64).reshape(count, 4)
        content.add_nodes(rows[:, 0], rows[:, 1:])
        return
    packed = cursor.numbers(28 * count, np.uint8).tobytes()
    kind = np.dtype([("number", f"{cursor.order}i4"), ("at", f"{cursor.order}f8", 3)])
    rows = np.frombuffer(packed, kind)
    content.add_nodes(rows["number"], rows["at"])


def read_elements(cursor: TextCursor | BinaryCursor, content: Content) -> None:
    """A count, then the elements of format 2."""
    content.repeats = True
    count = count_line(cursor)
    if isinstance(cursor, TextCursor):
        content.elements += grouped([_second_format_row(cursor) for _ in range(count)], cursor.fault)
        return
    blocks = []
    while count > 0:
        kind, many, tags = (int(n) for n in cursor.numbers(3, np.int32))
        if kind not in ELEMENTS or many < 1 or many > count or tags < 0:
            raise cursor.fault(f"{many} elements of type {kind} with {tags} tags are no block of format 2")
        width = 1 + tags + ELEMENTS[kind][1]
        rows = cursor.numbers(many * width, np.int32).astype(np.int64).reshape(many, width)
        blocks.append((kind, rows[:, 0], rows[:, 1] if tags else np.zeros(many, np.int64), rows[:, 1 + tags :]))
        count -= many
    content.elements += _by_group(blocks)


def _by_group(blocks: list[tuple[int, Ints, Ints, Ints]]) -> list[Elements]:
    together: dict[tuple[int, int], list[tuple[Ints, Ints]]] = {}
    for kind, numbers, groups, nodes in blocks:
        for group in np.unique(groups):
            its = groups == group
            together.setdefault((kind, int(group)), []).append((numbers[its], nodes[its]))
    return [
        Elements(kind, np.concatenate([n for n, _ in parts]), np.concatenate([c for _, c in parts]),
                 (group,) if group else ())
        for (kind, group), parts in together.items()
    ]  # fmt: skip


def _second_format_row(cursor: TextCursor) -> tuple[int, int, int, list[int]]:
    """number, type, count of tags, tags (physical group first), nodes."""
    row = _integers(cursor)
    tags = row[2] if len(row) > 2 else 0
    if len(row) < 3 or tags < 0 or row[1] not in ELEMENTS or len(row) != 3 + tags + ELEMENTS[row[1]][1]:
        raise cursor.fault("is no element: number, type, count of tags, tags, nodes")
    return row[0], row[1], row[3] if tags else 0, row[3 + tags :]


def _first_format_row(cursor: TextCursor) -> tuple[int, int, int, list[int]]:
    """number, type, physical group, entity, count of nodes, nodes."""
    row = _integers(cursor)
    if len(row) < 6 or row[1] not in ELEMENTS or not row[4] == len(row) - 5 == ELEMENTS[row[1]][1]:
        raise cursor.fault("is no element: number, type, group, entity, count of nodes, nodes")
    return row[0], row[1], row[2], row[5:]


def _integers(cursor: TextCursor) -> list[int]:
    return [integer(cursor, word) for word in cursor.line().split()]
