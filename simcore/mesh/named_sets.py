"""What the names of a file mean: node sets, sets of cells, arrays of numbers."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Callable

    from simcore.arrays import Ints
    from simcore.mesh.formats.raw import NumberArray, RawMesh


class NamedSetError(Exception):
    """A name that stands for no nodes of a file; says why."""


def known_names(raw: RawMesh) -> list[str]:
    """The names that a file offers; `array=NUMBER` for an array of integers."""
    filled = [array for array in raw.arrays if any(values is not None for values in array.values)]
    keys: dict[str, set[str]] = {}
    for array in filled:
        keys.setdefault(array.alias, set()).add(array.key)
    arrays = [
        (array.alias if len(keys[array.alias]) == 1 else array.key) + ("=NUMBER" if array.of_integers else "")
        for array in filled
    ]
    sets = [*raw.node_sets, *sorted({*raw.cell_sets, *raw.refused} - {*raw.node_sets})]
    return [*sets, *dict.fromkeys(arrays)]


def nodes_named(raw: RawMesh, name: str) -> Ints | None:
    """Rows of the points that `name` means, in this order: a node set; a cell set or physical group (the nodes of its
    cells); `array=number` (the nodes, or the nodes of the cells, where the array has that number); an array (where it
    is not zero). None for a name that the file has not; raises NamedSetError for one with two meanings or without any.
    """
    same = str.casefold if raw.ignores_case else str
    for refused, reason in raw.refused.items():
        if same(refused) == same(name):
            raise NamedSetError(reason)
    for sets in (raw.node_sets, raw.cell_sets):
        for key, nodes in sets.items():
            if same(key) == same(name):
                return nodes
    key, equals, number = name.rpartition("=")
    if equals and re.fullmatch(r"-?[0-9]{1,18}", number):
        return _nodes_where(raw, key, lambda values: values == int(number))
    return _nodes_where(raw, name, _is_marked)


def _is_marked(values: Any) -> Any:
    if values.dtype.kind == "f" and not np.isfinite(values).all():
        raise NamedSetError("is an array with numbers that are not finite")
    return values != 0


def _nodes_where(raw: RawMesh, name: str, test: Callable[[Any], Any]) -> Ints | None:
    """Where the arrays of a name pass a test; at the points and at each kind of cell it may have only one meaning."""
    found: dict[str, Ints] = {}
    arrays = [array for array in raw.arrays if name in (array.key, array.alias)]
    _refuse_repeated(arrays)
    for array in arrays:
        nodes = _of_array(raw, array, test)
        found[array.key] = np.union1d(found.get(array.key, nodes), nodes)
    meanings = {key: nodes for key, nodes in found.items() if len(nodes)}
    first = next(iter(meanings.values()), None)
    if first is not None and any(not np.array_equal(first, nodes) for nodes in meanings.values()):
        raise NamedSetError(f"means different nodes in {' and '.join(meanings)}; name one of these arrays")
    if not arrays:
        return None
    return np.zeros(0, np.int64) if first is None else first


def _refuse_repeated(arrays: list[NumberArray]) -> None:
    """Two arrays of one name at the same cells, such as steps of time, have no common meaning."""
    seen: set[tuple[str, int]] = set()
    for array in arrays:
        places = {(array.key, i) for i, values in enumerate(array.values) if values is not None}
        if places & seen:
            raise NamedSetError(f"is the name of two arrays, {array.key} and another; each needs a name of its own")
        seen |= places


def _of_array(raw: RawMesh, array: NumberArray, test: Callable[[Any], Any]) -> Ints:
    if array.at_points:
        return np.flatnonzero(test(array.values[0]))
    parts = [np.zeros(0, np.int64)]
    for block, values in zip(raw.blocks, array.values, strict=True):
        if values is None:
            continue
        passed = test(np.asarray(values))
        chosen = passed if passed.ndim == 1 else passed.any(axis=1)
        parts.append(block.nodes[chosen].ravel())
    return np.unique(np.concatenate(parts))
