"""What is in an uploaded model, data set or mesh is looked at before anything uses it: formats, bombs, pickles."""

from __future__ import annotations

import io
import json
import pickle
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from service.admission.upload_check import UnusableUploadError, read_content
from tests.service.http import idle_service
from tests.service.learned import dataset_bytes, model_bytes, npz_bomb, npz_member
from tests.service.store.uploads import arrays, send

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path


def looked(folder: Path, data: bytes, suffix: str = ".npz") -> Any:
    path = folder / f"file{suffix}"
    path.write_bytes(data)
    return read_content(path, "dataset" if suffix == ".npz" else "model")


def changed(data: bytes, **changes: Any) -> bytes:
    return json.dumps({**json.loads(data), **changes}).encode()


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        ({"format": "needlebench/other"}, "its format is"),
        ({"version": 2}, "of version 2"),
        ({"kind": "forest"}, "known are elm"),
        ({"kind": "linear"}, "has settings that cannot be"),
        ({"kind": ["elm"]}, "known are elm"),
        ({"inputs": 7}, "has 7 inputs and 3 outputs"),
        ({"outputs": None}, "outputs; a controller needs 6 and 3"),
        ({"settings": {"nodes": 4}}, "has the shape"),
        ({"settings": {"nodes": 10**12}}, "settings that cannot be"),
        ({"settings": {"nodes": 3.0}}, "its setting nodes is '3.0', where 25 would be one"),
        ({"settings": {"nodes": 3, "seed": "<b>"}}, "its setting seed"),
        ({"settings": {"nodes": 3, "seed": 10**400}}, "its seed is 1000"),
        ({"settings": {"nodes": 3, "ridge": True}}, "its setting ridge"),
        ({"settings": None}, "settings that cannot be"),
        ({"arrays": {}}, "must have exactly the arrays"),
        ({"arrays": None}, "must have exactly the arrays"),
        ({"provenance": None}, "no provenance"),
        ({"provenance": {"much": "x" * 300_000}}, "300 kB"),
        ({"provenance": {"deep": 1e400}}, "not JSON|not finite"),
    ],
)
def test_a_model_of_another_format_or_width_is_refused(tmp_path: Path, changes: dict[str, Any], told: str) -> None:
    with pytest.raises(UnusableUploadError, match=told):
        looked(tmp_path, changed(model_bytes("elm", nodes=3), **changes), ".json")


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        ({"format": np.array("other/1")}, "its format is other/1"),
        ({"tip_m": np.zeros((80, 2))}, "tip_m is float64"),
        ({"base_step_m": np.full((80, 3), np.nan)}, "80 rows that are not finite"),
        ({"trajectory": np.zeros((80, 2), np.int64)}, "160 whole numbers"),
        ({"trajectory": np.full(80, 9)}, "names more insertions than the 2"),
        ({"trajectory": np.full(80, -1)}, "80 whole numbers from 0"),
        ({"end_point_m": np.zeros(3)}, r"finite table \(insertions, 3\)"),
        ({"drawn": np.array([99])}, "row numbers"),
        ({"seed": np.array(-1)}, "whole number from 0"),
        ({"seed": np.array([1, 2])}, "."),
        ({"provenance": np.array("[]")}, "JSON object"),
        ({"provenance": np.array("{}")}, "scenario_template"),
        ({"provenance": np.array('{"scenario_template": {}, "path_box_mm": 1}')}, "lacks dt_s"),
        ({"provenance": np.array('{"a": NaN}')}, "not finite"),
        ({"provenance": np.array("{")}, "."),
    ],
)
def test_a_data_set_that_cannot_be_learned_from_is_refused(tmp_path: Path, changes: dict[str, Any], told: str) -> None:
    with np.load(io.BytesIO(dataset_bytes(rows=40))) as file:
        data = arrays(**{**file, **changes})
    with pytest.raises(UnusableUploadError, match=told):
        looked(tmp_path, data)


def header(shape: str, descr: str = "<f8", data: bytes = b"") -> bytes:
    text = f"{{'descr': '{descr}', 'fortran_order': False, 'shape': {shape}, }}".ljust(117) + "\n"
    return b"\x93NUMPY\x01\x00" + len(text).to_bytes(2, "little") + text.encode() + data


class Boom:
    """Would write a file when it is unpickled."""

    def __reduce__(self) -> tuple[Any, ...]:
        return (open, ("pickled", "w"))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("data", "told"),
    [
        (pickle.dumps(Boom()), "not an .npz"),
        (npz_member(pickle.dumps(Boom())), "not an array"),
        (arrays(w=np.array([Boom()], dtype=object)), "Python objects"),
        (npz_bomb, "unpacks to 300 MB"),
        (npz_member(header("(1000000000000,)")), "does not agree"),
        (npz_member(header("(-1,)")), "does not agree"),
        (npz_member(header("(" + "1," * 20_000 + ")")), "not an array"),
        (npz_member(header("(2,)", data=b"\x00" * 16), name="../w.npy"), "no array"),
        (npz_member(b"x", name="run.py"), "no array"),
        (b"PK\x03\x04" + b"\x00" * 100, "not an .npz"),
        (b"", "not an .npz"),
    ],
    ids=[
        "pickle",
        "pickle inside",
        "objects",
        "bomb",
        "too long",
        "negative",
        "many axes",
        "path",
        "code",
        "cut",
        "empty",
    ],
)
def test_bombs_and_pickles_are_refused_unread(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, data: bytes | Callable[[], bytes], told: str
) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(UnusableUploadError, match=told):
        looked(tmp_path, data() if callable(data) else data)
    assert not (tmp_path / "pickled").exists()


@pytest.mark.parametrize(
    "data",
    [b"[1]", b"{", b'{"a": NaN}', b'{"a": ' + b"[" * 60 + b"]" * 60 + b"}", b'{"a":' * 100_000, b"\xff"],
    ids=["list", "cut", "nan", "deep", "very deep", "binary"],
)
def test_json_that_is_no_plain_object_is_refused(tmp_path: Path, data: bytes) -> None:
    with pytest.raises(UnusableUploadError):
        looked(tmp_path, data, ".json")


@pytest.mark.slow
def test_a_mesh_that_expands_without_end_costs_a_refusal(tmp_path: Path) -> None:
    """A compressed .vtu of 8 MB that would unpack to 6 GB."""
    with idle_service(tmp_path) as (http, service):
        answer = send(http, vtu_bomb(), name="bomb.vtu")
        assert answer.status_code == 422, answer.text
        assert list(service.settings.uploads.iterdir()) == []


def vtu_bomb() -> bytes:
    import base64
    import zlib

    once = zlib.compress(b"\x00" * 20_000_000, 9)
    blocks = 300
    sizes = np.array([blocks, 20_000_000, 20_000_000, *[len(once)] * blocks], np.uint32)
    text = base64.b64encode(sizes.tobytes()).decode() + base64.b64encode(once * blocks).decode()
    points = f'<DataArray type="Float64" NumberOfComponents="3" format="binary">{text}</DataArray>'
    return (
        '<?xml version="1.0"?><VTKFile type="UnstructuredGrid" version="0.1" byte_order="LittleEndian" '
        'compressor="vtkZLibDataCompressor"><UnstructuredGrid><Piece NumberOfPoints="250000000" NumberOfCells="1">'
        f"<Points>{points}</Points><Cells></Cells></Piece></UnstructuredGrid></VTKFile>"
    ).encode()
