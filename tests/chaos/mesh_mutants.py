"""Mesh files changed at random: as other programs might write them, damaged, cut off; and what may come of each."""

from __future__ import annotations

import re
from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from simcore.mesh.reading import read_body
from tests.simcore.mesh.test_mesh_cases import FILES
from tests.simcore.mesh.test_mesh_file import write_box

if TYPE_CHECKING:
    import random
    from collections.abc import Callable

    from simcore.mesh.reading import Body

SOUND = (
    "nset_union.inp", "nset_twice.inp", "nset_names.inp", "node_nset.inp", "elset_between.inp", "nset_gen2.inp",
    "c3d4h.inp", "lower.inp", "with_mass.inp", "node_two_blocks.inp", "refpoint.inp", "box_groups_saveall.msh",
    "box_groups_saveall22.msh", "sphere_v1.0_asc.msh", "sphere_v4.0_asc.msh",
)  # fmt: skip
WRITTEN = ("gmsh4.msh", "gmsh2.msh", "ascii.msh", "box.vtu", "box.vtk", "box.mesh", "box.inp")
_LINE_BY_LINE = (".inp", ".mesh", "box_groups_saveall22.msh", "sphere_v1.0_asc.msh")  # a line is a node or a cell
_NUMBERS = re.compile(rb"[0-9.,+\-eE \t\r]*[0-9][0-9.,+\-eE \t\r]*")
_TOKENS = (b"-", b"9999999999999", b"nan", b",", b"\n", b" 1e400 ", b"0", b"1_0", b"\x00", b'"', b"*", b"$", b"<", b" ")
_LINE_NODES = 24  # that one line of a file can be about: Abaqus has 16 numbers in a line

Corner = tuple[float, ...]
Shape = tuple[Counter[tuple[Corner, ...]], dict[str, set[Corner]]]


@dataclass(frozen=True)
class Sound:
    """A file that is read, and what is in it. local: each line of numbers is about one node or one cell."""

    name: str
    data: bytes
    shape: Shape
    local: bool

    @property
    def suffix(self) -> str:
        return Path(self.name).suffix

    @property
    def is_text(self) -> bool:
        return b"\x00" not in self.data and self.suffix != ".vtu"


@dataclass(frozen=True)
class Mutant:
    """A changed file. same: it says the same. near: it differs in one line of numbers, so what is in it does too."""

    of: Sound
    way: str
    data: bytes
    same: bool = False
    near: bool = False


def sound_files(folder: Path) -> list[Sound]:
    """Those of the repository, and the box of the tests in every format that is written elsewhere."""
    paths = [FILES / name for name in SOUND] + [write_box(folder, name)[0] for name in WRITTEN]
    return [_sound(path) for path in paths]


def _sound(path: Path) -> Sound:
    data = path.read_bytes()
    generated = b"GENERATE" in data.upper()  # of three numbers many nodes
    local = path.name.endswith(_LINE_BY_LINE) and not generated
    return Sound(path.name, data, shape_of(read_body(data, path.suffix, None, 1.0)), local)


def shape_of(body: Body) -> Shape:
    """Tetrahedra by their corners and sets by their points: whatever the order that a file has them in."""
    points = [tuple(float(x) for x in point) for point in body.points.round(9) + 0.0]
    tets = Counter(tuple(sorted(points[i] for i in tet)) for tet in body.tets.tolist())
    return tets, {name.casefold(): {points[i] for i in rows} for name, rows in body.sets.items()}


def mutant(sound: Sound, chance: random.Random) -> Mutant:
    """One of the ways, at a random place."""
    way = chance.choice(_GENTLE if sound.is_text and chance.random() < 0.4 else _ROUGH)
    return way(sound, chance)


def fault_of(changed: Mutant, body: Body) -> str | None:
    """What must not be of a mutant that was read; None when all is as it may be."""
    tets, sets = shape_of(body)
    before_tets, before_sets = changed.of.shape
    if not tets or any(not points for points in sets.values()):
        return "nothing, or an empty set"
    if changed.same and (tets, sets) != changed.of.shape:
        return "it says the same and was read as something else"
    if not changed.near:
        return None
    most = 4 * max(Counter(corner for tet in before_tets for corner in tet).values())  # two nodes, before and after
    apart = sum(((tets - before_tets) + (before_tets - tets)).values())
    if apart > most:
        return f"one line was changed and {apart} tetrahedra are others"
    for name in before_sets.keys() & sets.keys():
        if len(before_sets[name] ^ sets[name]) > 2 * _LINE_NODES:
            return f"one line was changed and {len(before_sets[name] ^ sets[name])} nodes of {name} are others"
    return None


# -- as others write it


def _crlf(sound: Sound, _chance: random.Random) -> Mutant:
    return Mutant(sound, "CR LF", sound.data.replace(b"\r\n", b"\n").replace(b"\n", b"\r\n"), same=True)


def _wide(sound: Sound, _chance: random.Random) -> Mutant:
    def widened(line: bytes) -> bytes:
        return line.replace(b",", b" ,\t").replace(b" ", b"   ") if _NUMBERS.fullmatch(line) else line

    return Mutant(sound, "blanks", b"\n".join(map(widened, sound.data.split(b"\n"))), same=True)


def _case(sound: Sound, chance: random.Random) -> Mutant:
    if sound.suffix != ".inp":
        return _crlf(sound, chance)
    changed = chance.choice([bytes.upper, bytes.lower, bytes.swapcase])
    return Mutant(sound, "case", changed(sound.data), same=True)


def _remarks(sound: Sound, chance: random.Random) -> Mutant:
    if sound.suffix != ".inp":
        return _wide(sound, chance)
    lines = sound.data.split(b"\n")
    for _ in range(20):
        lines.insert(chance.randrange(len(lines) + 1), b"** 1, 2, 3, 4, 5")
    return Mutant(sound, "remarks", b"\n".join(lines), same=True)


def _other_order(sound: Sound, chance: random.Random) -> Mutant:
    """Two lines of numbers that follow each other change places; where they are numbered, nothing else changes."""
    lines = sound.data.split(b"\n")
    pairs = [i for i in range(len(lines) - 1) if all(map(_NUMBERS.fullmatch, lines[i : i + 2]))]
    at = chance.choice(pairs)
    lines[at], lines[at + 1] = lines[at + 1], lines[at]
    return Mutant(sound, "order", b"\n".join(lines), near=sound.local)


# -- damaged


def _byte(sound: Sound, chance: random.Random) -> Mutant:
    at = chance.randrange(len(sound.data))
    data = sound.data[:at] + bytes([chance.randrange(256)]) + sound.data[at + 1 :]
    return Mutant(sound, "byte", data, near=_is_near(sound, data, at))


def _token(sound: Sound, chance: random.Random) -> Mutant:
    at = chance.randrange(len(sound.data))
    data = sound.data[:at] + chance.choice(_TOKENS) + sound.data[at:]
    return Mutant(sound, "token", data, near=_is_near(sound, data, at))


def _digit(sound: Sound, chance: random.Random) -> Mutant:
    places = [
        i for i in chance.sample(range(len(sound.data)), min(200, len(sound.data))) if sound.data[i] in b"0123456789"
    ]
    if not places:
        return _byte(sound, chance)
    at = places[0]
    data = sound.data[:at] + chance.choice([b"0", b"5", b"9", b"-", b".", b""]) + sound.data[at + 1 :]
    return Mutant(sound, "digit", data, near=_is_near(sound, data, at))


def _line(sound: Sound, chance: random.Random) -> Mutant:
    """A line is left out, or is there twice."""
    lines = sound.data.split(b"\n")
    at = chance.randrange(len(lines))
    near = sound.local and _NUMBERS.fullmatch(lines[at]) is not None
    kept = chance.choice([[], [lines[at], lines[at]]])
    return Mutant(sound, "line", b"\n".join([*lines[:at], *kept, *lines[at + 1 :]]), near=near)


def _cut(sound: Sound, chance: random.Random) -> Mutant:
    return Mutant(sound, "cut", sound.data[: chance.randrange(len(sound.data))])


def _blocks(sound: Sound, chance: random.Random) -> Mutant:
    """A piece of the file at another place of it."""
    first, last, to = sorted(chance.randrange(len(sound.data)) for _ in range(3))
    return Mutant(sound, "piece", sound.data[:first] + sound.data[last:to] + sound.data[first:last] + sound.data[to:])


def _is_near(sound: Sound, data: bytes, at: int) -> bool:
    """Whether only the line at this place differs, and it holds numbers as before."""
    if not sound.local or sound.data.count(b"\n") != data.count(b"\n"):
        return False
    return all(_NUMBERS.fullmatch(_line_at(text, at)) for text in (sound.data, data))


def _line_at(data: bytes, at: int) -> bytes:
    end = data.find(b"\n", at)
    return data[data.rfind(b"\n", 0, at) + 1 : len(data) if end < 0 else end]


_GENTLE: tuple[Callable[[Sound, random.Random], Mutant], ...] = (_crlf, _wide, _case, _remarks, _other_order)
_ROUGH: tuple[Callable[[Sound, random.Random], Mutant], ...] = (
    _byte,
    _token,
    _digit,
    _digit,
    _line,
    _line,
    _cut,
    _blocks,
)
