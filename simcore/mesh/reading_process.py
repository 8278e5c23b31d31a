"""Reads a mesh file in a process of its own, with a limit on its memory and time: a file may be made to take both.

The process gets the content, never a path: whatever the content asks for, no other file is within its reach.
"""

from __future__ import annotations

import io
import json
import os
import subprocess
import sys

import numpy as np

from simcore.mesh.reading import Body, MeshFaultError, read_body

MEMORY_MB = 2000
TIME_S = 60
_START = (
    "import json, sys; sys.path[:] = json.loads(sys.argv[1]); "
    "from simcore.mesh.reading_process import main; main(sys.argv[2])"
)


def read_apart(data: bytes, suffix: str, wanted: tuple[str, ...] | None, unit_mm: float | None) -> Body:
    """`read_body` in another process. Raises MeshFaultError, also where the limits are reached."""
    request = json.dumps({"suffix": suffix, "wanted": wanted, "unit_mm": unit_mm})
    command = [sys.executable, "-I", "-X", "utf8", "-c", _START, json.dumps(sys.path), request]
    single = {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}
    try:
        done = subprocess.run(
            command, input=data, capture_output=True, env={**os.environ, **single}, timeout=2 * TIME_S, check=False
        )
    except subprocess.TimeoutExpired:
        raise MeshFaultError(f"takes longer than {2 * TIME_S} s to read") from None
    if done.returncode:
        raise MeshFaultError(f"takes more than {TIME_S} s or {MEMORY_MB} MB to read")
    return _unpacked(done.stdout)


def main(request: str) -> None:
    """Read the content from standard input; write the body, or the fault, to standard output."""
    _limit_resources()
    asked = json.loads(request)
    wanted = None if asked["wanted"] is None else tuple(asked["wanted"])
    try:
        packed = _packed(read_body(sys.stdin.buffer.read(), asked["suffix"], wanted, asked["unit_mm"]))
    except MeshFaultError as fault:
        packed = json.dumps({"fault": fault.message, "set": fault.set_name}).encode() + b"\n"
    except MemoryError:
        packed = json.dumps({"fault": f"takes more than {MEMORY_MB} MB to read", "set": None}).encode() + b"\n"
    except Exception as error:  # noqa: BLE001 -- whatever a file does to its reader, its user gets one sentence
        reason = f"cannot be read: its reader stopped at something unforeseen ({type(error).__name__})"
        packed = json.dumps({"fault": reason, "set": None}).encode() + b"\n"
    sys.stdout.buffer.write(packed)
    sys.stdout.buffer.flush()


def _packed(body: Body) -> bytes:
    """A line of JSON, then points, tetrahedra and sets as arrays."""
    out = io.BytesIO()
    head = {"names": body.names, "remarks": body.remarks, "refused": body.refused, "sets": list(body.sets)}
    out.write(json.dumps(head).encode() + b"\n")
    for array in (body.points, body.tets, *body.sets.values()):
        np.save(out, array, allow_pickle=False)
    return out.getvalue()


def _unpacked(data: bytes) -> Body:
    stream = io.BytesIO(data)
    head = json.loads(stream.readline())
    if "fault" in head:
        raise MeshFaultError(head["fault"], head["set"])
    points, tets = (np.load(stream, allow_pickle=False) for _ in range(2))
    sets = {name: np.load(stream, allow_pickle=False) for name in head["sets"]}
    return Body(points, tets, sets, tuple(head["names"]), tuple(head["remarks"]), head["refused"])


def _limit_resources() -> None:
    """Limit memory, time and file size of this process, for good; Windows has the limit on time alone."""
    if sys.platform == "win32":
        return
    import resource

    for kind, most in (
        (resource.RLIMIT_AS, MEMORY_MB * 10**6),
        (resource.RLIMIT_CPU, TIME_S),
        (resource.RLIMIT_FSIZE, 0),
        (resource.RLIMIT_CORE, 0),
    ):
        hard = resource.getrlimit(kind)[1]
        limit = most if hard == resource.RLIM_INFINITY else min(most, hard)
        resource.setrlimit(kind, (limit, limit))
