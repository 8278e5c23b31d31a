"""The lines of an .inp as keywords with their data, and the types of elements."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from simcore.mesh.formats.cursor import as_text
from simcore.mesh.formats.raw import FormatError

if TYPE_CHECKING:
    from collections.abc import Iterator

KINDS = (
    ("tetra", 4, re.compile(r"(DC3D|AC3D|C3D|Q3D)4[A-Z]*")),
    ("triangle", 3, re.compile(r"(S|SFM3D|M3D|R3D|CPE|CPS|CAX|DS|DC2D|AC2D)3[A-Z]*|STRI3")),
    ("quad", 4, re.compile(r"(S|SFM3D|M3D|R3D|CPE|CPS|CAX|DS|DC2D|AC2D)4[A-Z]*")),
    ("line", 2, re.compile(r"(B[23]1|T[23]D2|R2D2|PIPE[23]1)[A-Z]*")),
)
SOLID = re.compile(r"(D|DC|DCC|AC|EM|E|COH|Q|G|I|C)?C?3D\d+[A-Z0-9]*|SC[68][A-Z]*|CSS8[A-Z]*|CCL\d+[A-Z]*|CIN3D.*")
_NUMBER = re.compile(r"[+-]?([0-9]{1,40}\.?[0-9]{0,40}|\.[0-9]{1,40})([ED][+-]?[0-9]{1,2})?", re.IGNORECASE)


@dataclass
class Keyword:
    """A line that begins with an asterisk, and the data lines after it: (number of the line, its fields)."""

    name: str
    parameters: dict[str, str]
    line: int
    data: list[tuple[int, list[str]]] = field(default_factory=list)

    def fault(self, reason: str, line: int | None = None) -> FormatError:
        """The error that says what is wrong with it, or with one of its data lines."""
        return FormatError(f"line {line or self.line}: {reason}")

    def integer(self, line: int, text: str) -> int:
        """A number of a node or an element. Raises FormatError."""
        if not re.fullmatch(r"[0-9]{1,17}", text):
            raise self.fault(f"{text[:40]!r} is not a number of *{self.name}", line)
        return int(text)

    def floats(self, line: int, fields: list[str]) -> list[float]:
        """Coordinates; an empty one is 0. Raises FormatError."""
        if not all(not text or _NUMBER.fullmatch(text) for text in fields):
            raise self.fault(f"{', '.join(fields)[:60]!r} are not coordinates", line)
        return [float(text.upper().replace("D", "E")) if text else 0.0 for text in fields]


def keywords(data: bytes) -> Iterator[Keyword]:
    """The keywords of a file with their data. Raises FormatError."""
    current: Keyword | None = None
    begun = ""
    for number, raw_line in enumerate(data.splitlines(), 1):
        line = as_text(raw_line).strip()
        if not line or line.startswith("**"):
            continue
        if begun or line.startswith("*"):
            begun += line
            if begun.endswith(","):
                continue
            if current is not None:
                yield current
            current, begun = _keyword(begun, number), ""
        elif current is None:
            raise FormatError(f"line {number}: the file must begin with a keyword, such as *NODE")
        elif current.name in DATA:
            current.data.append((number, [text.strip() for text in line.split(",")]))
    if begun:
        raise FormatError(f"the file ends within the keyword {begun[:40]!r}")
    if current is not None:
        yield current


DATA = ("NODE", "ELEMENT", "NSET", "ELSET", "INSTANCE")  # the keywords whose data lines are read


def _keyword(text: str, number: int) -> Keyword:
    name, *parameters = (part.strip() for part in text.removeprefix("*").split(","))
    pairs = [parameter.partition("=") for parameter in parameters if parameter]
    values = {key.strip().upper(): value.strip().strip('"') for key, _, value in pairs}
    return Keyword(" ".join(name.upper().split()), values, number)


def kind_of(keyword: Keyword) -> tuple[str | None, int | None]:
    """The kind of *ELEMENT's cells with the count of their nodes; None for what is no part of a mesh.

    Raises FormatError for solids that are no linear tetrahedra.
    """
    name = keyword.parameters.get("TYPE", "").upper()
    if not name:
        raise keyword.fault("*ELEMENT needs TYPE=")
    for kind, corners, pattern in KINDS:
        if pattern.fullmatch(name):
            return kind, corners
    if SOLID.fullmatch(name):
        raise keyword.fault(f"must hold linear tetrahedra (C3D4) and no other solid cells; it holds {name[:20]}")
    return None, None


def element_rows(keyword: Keyword, corners: int | None) -> Iterator[tuple[int, list[int]]]:
    """(line, [number, nodes]) of each element; after a comma it goes on in the next line. Raises FormatError."""
    row: list[int] = []
    begin = 0
    for line, fields in keyword.data:
        begin = begin if row else line
        row += [keyword.integer(line, text) for text in fields if text]
        whole = fields[-1] != "" if corners is None else len(row) == corners + 1
        if corners is not None and len(row) > corners + 1:
            raise _miscounted(keyword, corners, row, line)
        if whole:
            yield begin, row
            row = []
    if row and corners is not None:
        raise _miscounted(keyword, corners, row, begin)
    if row:
        yield begin, row


def _miscounted(keyword: Keyword, corners: int, row: list[int], line: int) -> FormatError:
    return keyword.fault(f"{keyword.parameters['TYPE'][:20]} has {corners} nodes, here are {len(row) - 1}", line)
