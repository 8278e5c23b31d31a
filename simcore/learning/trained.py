"""Trained models as JSON files: never pickled, bounded, checked on reading, named by the digest of their content."""

from __future__ import annotations

import hashlib
import json
import stat
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from simcore.errors import NeedlebenchError, Problem, ScenarioError
from simcore.file_names import located, with_content
from simcore.learning.elm import ExtremeLearningMachine
from simcore.learning.linear import LinearModel
from simcore.learning.mlp import MultilayerPerceptron
from simcore.learning.neighbours import NearestNeighbours
from simcore.learning.regressor import SCALES, Arrays, DataError, Regressor

if TYPE_CHECKING:
    from simcore.arrays import Floats

FORMAT = "needlebench/model"
VERSION = 1
INPUTS, OUTPUTS = 6, 3  # (P, e_p) and Delta P, metres [paper]
MAXIMUM_MB = 50
DEFAULT = "default"
PACKAGED = Path(__file__).resolve().parent.parent / "models"
FIELD = "controller.model"

REGRESSORS: dict[str, type[Regressor]] = {
    regressor.kind: regressor
    for regressor in (ExtremeLearningMachine, LinearModel, NearestNeighbours, MultilayerPerceptron)
}


class ModelFaultError(NeedlebenchError, ValueError):
    """A text that is no usable model; the message says what is wrong with it."""


@dataclass(frozen=True)
class TrainedModel:
    """A regressor that has learned, and where it comes from (JSON data)."""

    regressor: Regressor
    provenance: dict[str, Any]

    def text(self) -> str:
        """The content of its file: the same model gives the same text."""
        content = {
            "format": FORMAT,
            "version": VERSION,
            "kind": self.regressor.kind,
            "inputs": self.regressor.inputs,
            "outputs": self.regressor.outputs,
            "settings": self.regressor.settings(),
            "provenance": self.provenance,
            "arrays": {name: array.tolist() for name, array in self.regressor.arrays.items()},
        }
        return json.dumps(content, indent=1, allow_nan=False) + "\n"


def parse_model(data: bytes, kind: str) -> TrainedModel:
    """The model in the content of a file, which must be of this kind. Raises ModelFaultError."""
    content = _object(data)
    if content.get("format") != FORMAT:
        raise ModelFaultError(f"is not a model: its format is {content.get('format')!r}, not {FORMAT!r}")
    if content.get("version") != VERSION:
        raise ModelFaultError(f"is a model of version {content.get('version')!r}; this program reads version {VERSION}")
    if content.get("kind") != kind:
        raise ModelFaultError(f"is a model of kind {content.get('kind')!r}, not {kind!r}")
    width = (content.get("inputs"), content.get("outputs"))
    if width != (INPUTS, OUTPUTS):
        raise ModelFaultError(
            f"has {width[0]} inputs and {width[1]} outputs; a controller needs {INPUTS} and {OUTPUTS}"
        )
    provenance = content.get("provenance")
    if not isinstance(provenance, dict):
        raise ModelFaultError("has no provenance")
    regressor = _built(kind, content.get("settings"))
    return TrainedModel(regressor.keep(_arrays(content.get("arrays"), regressor)), provenance)


def _object(data: bytes) -> dict[str, Any]:
    try:
        content = json.loads(data)
    except (ValueError, RecursionError) as error:
        raise ModelFaultError(f"is not readable JSON: {error}") from None
    if not isinstance(content, dict):
        raise ModelFaultError("must hold a JSON object")
    return content


def _built(kind: str, settings: Any) -> Regressor:
    try:
        return REGRESSORS[kind](**settings)
    except (DataError, TypeError, ValueError) as error:
        raise ModelFaultError(f"has settings that cannot be: {error}") from None


def _arrays(found: Any, regressor: Regressor) -> Arrays:
    scales = (("input_mean", INPUTS), ("input_scale", INPUTS), ("output_mean", OUTPUTS), ("output_scale", OUTPUTS))
    shapes = {**{name: (width,) for name, width in scales}, **regressor.shapes(INPUTS, OUTPUTS)}
    if not isinstance(found, dict) or set(found) != set(shapes):
        raise ModelFaultError(f"must have exactly the arrays {', '.join(shapes)}")
    arrays = {name: _array(name, found[name], shape) for name, shape in shapes.items()}
    rows = {len(arrays[name]) for name, shape in shapes.items() if shape[0] == -1}
    if len(rows) > 1:
        raise ModelFaultError(f"has arrays of {' and '.join(str(n) for n in sorted(rows))} rows that must be as long")
    if any((arrays[name] <= 0.0).any() for name in SCALES if name.endswith("scale")):
        raise ModelFaultError("has a scale that is not above 0")
    return arrays


def _array(name: str, value: Any, shape: tuple[int, ...]) -> Floats:
    try:
        array = np.array(value, dtype=np.float64)
    except (TypeError, ValueError):
        raise ModelFaultError(f"array {name} is not made of numbers") from None
    if array.ndim != len(shape) or array.size == 0 or any(n not in (-1, m) for n, m in zip(shape, array.shape)):  # noqa: B905
        raise ModelFaultError(f"array {name} has the shape {array.shape}, not {shape}")
    if not np.isfinite(array).all():
        raise ModelFaultError(f"array {name} holds values that are not finite")
    return array


# ---- by the name that a scenario gives

_known: dict[tuple[str, str], TrainedModel] = {}  # by kind and digest: what was read once needs no file any more
_MOST_KNOWN = 16


def model_digest(kind: str, name: str, sha256: str | None) -> str:
    """Read and check the model that a scenario names; its SHA-256. Raises ScenarioError.

    What counts is the content: with a digest that the named file has not (any more), a model with it is looked for
    among those that come along and where `file_names.content_in` says.
    """
    data = _content_of(kind, name, sha256)
    found = hashlib.sha256(data).hexdigest()
    if sha256 not in (None, found):
        wrong = f"has changed: its SHA-256 is {found}, {FIELD}_sha256 is {sha256}"
        raise ScenarioError([Problem(FIELD, name, wrong)])
    if (kind, found) not in _known:
        try:
            model = parse_model(data, kind)
        except ModelFaultError as wrong:
            raise ScenarioError([Problem(FIELD, name, str(wrong))]) from None
        while len(_known) >= _MOST_KNOWN:
            del _known[next(iter(_known))]
        _known[kind, found] = model
    return found


def load_model(kind: str, name: str, sha256: str) -> TrainedModel:
    """The model of a checked scenario. Raises ScenarioError if it has to be read again and has changed."""
    if (kind, sha256) not in _known:
        model_digest(kind, name, sha256)
    return _known[kind, sha256]


def _content_of(kind: str, name: str, sha256: str | None) -> bytes:
    """The named file, or another one that has the digest."""
    try:
        data = _content(kind, name)
    except ScenarioError:
        if sha256 is None or (file := with_content(sha256, ".json", PACKAGED)) is None:
            raise
        return file.read_bytes()
    if sha256 is None or hashlib.sha256(data).hexdigest() == sha256:
        return data
    file = with_content(sha256, ".json", PACKAGED)
    return data if file is None else file.read_bytes()


def _content(kind: str, name: str) -> bytes:
    file = PACKAGED / f"{kind}.json" if name == DEFAULT else located(FIELD, name)
    if name == DEFAULT and not file.is_file():
        made = f"needlebench train --kind {kind} --data FILE.npz --out MODEL.json"
        raise ScenarioError([Problem(FIELD, name, f"no model of kind {kind} comes along; make one: {made}")])
    try:
        entry = file.stat()
        wrong = None
        if not stat.S_ISREG(entry.st_mode):
            wrong = "is not a file"
        elif entry.st_size > MAXIMUM_MB * 1_000_000:
            wrong = f"holds {entry.st_size / 1e6:.0f} MB, at most {MAXIMUM_MB} are allowed"
        data = b"" if wrong else file.read_bytes()
    except (OSError, ValueError) as error:
        wrong = f"cannot be read: {getattr(error, 'strerror', None) or error}"
    if wrong:
        raise ScenarioError([Problem(FIELD, name, wrong)])
    return data
