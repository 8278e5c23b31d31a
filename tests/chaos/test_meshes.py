"""Thousands of changed mesh files: each is read right or refused in a sentence, and a service keeps nothing of them."""

from __future__ import annotations

import threading
from collections import Counter
from concurrent.futures import ThreadPoolExecutor
from typing import TYPE_CHECKING

from service.client.client import ServiceError
from simcore.mesh.reading import MeshFaultError
from simcore.mesh.reading_process import read_apart
from tests.acceptance.server import running_server
from tests.chaos.flat import Held
from tests.chaos.mesh_mutants import Mutant, fault_of, mutant, sound_files

if TYPE_CHECKING:
    import random
    from pathlib import Path

    from needlebench import Client

_SENT_EACH = 10  # of so many one is sent to a service too
_MORE_DESCRIPTORS, _MORE_MB = 10, 20.0  # [ours] that the service may hold after the last beyond after the first tenth


def test_changed_meshes(tmp_path: Path, meshes: int, chance: random.Random, figures: dict[str, object]) -> None:
    sound = sound_files(tmp_path)
    mutants = [mutant(sound[number % len(sound)], chance) for number in range(meshes)]
    ends: Counter[str] = Counter()
    wrong: list[str] = []
    turn = threading.Lock()

    def tried(changed: Mutant) -> None:
        end, fault = _end_of(changed)
        with turn:
            ends[end] += 1
            if fault is not None:
                wrong.append(_kept(tmp_path, changed, fault))

    with ThreadPoolExecutor(2) as pool:
        list(pool.map(tried, mutants))
    assert not wrong, f"{len(wrong)} of {len(mutants)}:\n" + "\n".join(wrong[:20])
    assert ends["read"]
    assert ends["refused"]
    figures.update(meshes=len(mutants), ways=len({one.way for one in mutants}), **ends)
    figures.update(_sent(tmp_path, mutants[::_SENT_EACH]))


def _end_of(changed: Mutant) -> tuple[str, str | None]:
    """What became of it in a process of its own with limits; and what is wrong with that."""
    try:
        body = read_apart(changed.data, changed.of.suffix, None, 1.0)
    except MeshFaultError as refusal:
        said = refusal.message
        bad = not said.isprintable() or "unforeseen" in said or "takes more than" in said or "takes longer" in said
        return "refused", said if bad else None
    return "read", fault_of(changed, body)


def _kept(folder: Path, changed: Mutant, fault: str) -> str:
    """A line about a mutant that went wrong, which is left for a look."""
    path = folder / f"wrong-{abs(hash(changed.data))}{changed.of.suffix}"
    path.write_bytes(changed.data)
    return f"{changed.of.name}, {changed.way}: {fault}: {path}"


def _sent(folder: Path, mutants: list[Mutant]) -> dict[str, object]:
    """Upload them: 201, or a problem that is the sender's; what the service holds stays the same."""
    statuses: Counter[int] = Counter()
    with running_server(folder / "data") as server:
        held = [Held.by(server.process.pid)]
        for number, changed in enumerate(mutants):
            statuses[_status(server.client, folder, changed)] += 1
            if number == len(mutants) // 10:
                held.append(Held.by(server.process.pid))
        held.append(Held.by(server.process.pid))
        assert server.process.poll() is None
    assert set(statuses) <= {201, 422}, statuses
    _, first, last = held
    assert last.processes == first.processes
    assert last.descriptors <= first.descriptors + _MORE_DESCRIPTORS
    assert last.memory_mb <= first.memory_mb + _MORE_MB
    memory = [one.memory_mb for one in held]
    return {"uploads": dict(statuses), "descriptors": [one.descriptors for one in held], "memory_mb": memory}


def _status(client: Client, folder: Path, changed: Mutant) -> int:
    path = folder / f"sent{changed.of.suffix}"
    path.write_bytes(changed.data)
    try:
        client.upload(path)
    except ServiceError as refusal:
        return refusal.status
    return 201
