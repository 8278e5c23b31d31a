"""What an arm is: a controller with its settings, its code and the content of the files that they name.

Two insertions were steered by the same arm if and only if the ids of their arms are equal. Everything that groups,
pairs or verifies runs by their controller asks here.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass
from typing import Any

from simcore.controller_code import Code, file_sha256
from simcore.errors import ScenarioError
from simcore.file_names import located
from simcore.plugins import code_of

PLUGIN, REMOTE = "plugin", "remote"
_REMOTE = ("clock", "look_ahead", "settings")  # what of a remote controller's block is not its connection
CONDITIONS = (  # fields of a controller's block that act on whatever steers: no part of an arm
    "delay_s",
    "start_timeout_s",
    "connect_timeout_s",
    "step_timeout_s",
)
_CONTENT = {"model": "model_sha256", "poses_file": "poses_sha256"}  # fields that name a file -> its digest
_LONGEST_NAME = 1000  # characters of a setting that may be the name of a file
_LONGEST_VALUE = 24  # characters of a setting that are shown in a name
Json = dict[str, Any]


@dataclass(frozen=True, kw_only=True)
class Arm:
    """controller: name of a plug-in or a remote one, else the kind. settings: JSON, without what is given by content.
    version, code_sha256: of a plug-in, see `controller_code`; None for a kind of needlebench, whose commit says them,
    and for a remote controller, whose code is elsewhere. files: SHA-256 of each file that the settings name, by
    setting; poses given inline are one too."""

    kind: str
    controller: str
    settings: Json
    version: str | None
    code_sha256: str | None
    files: dict[str, str]

    @property
    def id(self) -> str:
        """16 hexadecimal digits of the digest over everything that an arm is."""
        text = json.dumps(asdict(self), sort_keys=True, separators=(",", ":"))
        return hashlib.sha256(text.encode()).hexdigest()[:16]

    @property
    def edition(self) -> str:
        """The code in a few letters, as in "1.2, code 3f2a90c1"; empty for a kind of needlebench."""
        code = "" if self.code_sha256 is None else f"code {self.code_sha256[:8]}"
        return ", ".join(part for part in (self.version, code) if part)

    def data(self) -> Json:
        """As JSON data, with the id."""
        return {"id": self.id, **asdict(self)}

    @classmethod
    def of_data(cls, data: Mapping[str, Any]) -> Arm:
        """The arm that `data` wrote. Raises KeyError."""
        return cls(**{name: data[name] for name in cls.__dataclass_fields__})


def arm_of(scenario: Mapping[str, Any]) -> Arm:
    """The arm of a scenario's JSON, with the code as this process has it. Names of files are looked up as
    `file_names` says at that moment; what cannot be found there is no file of the arm."""
    block = dict(scenario.get("controller") or {"kind": "ifem"})
    kind = str(block.pop("kind", "ifem"))
    for name in CONDITIONS:
        block.pop(name, None)
    if kind == PLUGIN:
        name, settings = str(block.get("name")), dict(block.get("settings") or {})
        code = _code(name)
        files = dict(_named_files(settings))
        return Arm(
            kind=kind,
            controller=name,
            settings=settings,
            version=code.version,
            code_sha256=code.sha256,
            files=files,
        )
    if kind == REMOTE:
        settings = {name: block[name] for name in _REMOTE if block.get(name)}
        name = str(block.get("name", kind))
        return Arm(kind=kind, controller=name, settings=settings, version=None, code_sha256=None, files={})
    files = _content(block)
    settings = _without_derived(block, scenario)
    return Arm(kind=kind, controller=kind, settings=settings, version=None, code_sha256=None, files=files)


def _code(name: str) -> Code:
    try:
        return code_of(name)
    except (LookupError, OSError):
        return Code(None, None)


def _content(block: Json) -> dict[str, str]:
    """Takes out of a block what is known by its content; the digests."""
    found = {}
    for name, digest in _CONTENT.items():
        sha256 = block.pop(digest, None)
        if sha256 is not None:
            block.pop(name, None)
            found[name] = str(sha256)
    if (poses := block.pop("poses", None)) is not None:
        found["poses"] = hashlib.sha256(json.dumps(poses).encode()).hexdigest()
    return found


def _without_derived(block: Json, scenario: Mapping[str, Any]) -> Json:
    """A block whose model has a spacing of its own only where that does not follow from the plant's."""
    model, interaction = block.get("model"), scenario.get("interaction") or {}
    if not isinstance(model, dict) or model.get("spacing_mm") is None:
        return block
    hard = not interaction.get("line_compliance", True)
    derived = max(interaction.get("spacing_mm") or 0.0, model.get("element_size_mm", 0.0) if hard else 0.0)
    return {**block, "model": {**model, "spacing_mm": None}} if model["spacing_mm"] == derived else block


def _named_files(value: Any, place: str = "") -> list[tuple[str, str]]:
    """(setting, SHA-256) of every text in a plug-in's settings that names a file."""
    if isinstance(value, Mapping):
        return [one for name, item in value.items() for one in _named_files(item, f"{place}.{name}" if place else name)]
    if isinstance(value, list | tuple):
        return [one for number, item in enumerate(value) for one in _named_files(item, f"{place}[{number}]")]
    if not isinstance(value, str) or not 0 < len(value) <= _LONGEST_NAME:
        return []
    try:
        file = located(f"controller.settings.{place}", value)
        return [(place, file_sha256(file))] if file.is_file() else []
    except (ScenarioError, OSError, ValueError):
        return []


# ---- names for people


def arm_names(arms: Iterable[Arm]) -> dict[str, str]:
    """A short name of each arm by its id: its controller, and where several arms have that what sets them apart, as in
    "ifem gain 0.5". Different arms have different names."""
    known = {arm.id: arm for arm in arms}
    members: dict[str, list[Arm]] = {}
    for arm in known.values():
        members.setdefault(_base(arm, known.values()), []).append(arm)
    names: dict[str, str] = {}
    for base, mine in members.items():
        features = {arm.id: _features(arm) for arm in mine}
        paths = dict.fromkeys(path for one in features.values() for path in one)
        apart = [path for path in paths if len({one.get(path) for one in features.values()}) > 1]
        for arm_id, one in features.items():
            names[arm_id] = " ".join([base, ", ".join(f"{_leaf(path)} {one[path]}" for path in apart if path in one)])
    taken = list(names.values())
    return {one: (name if taken.count(name) == 1 else f"{name} {one[:6]}").strip() for one, name in names.items()}


def _base(arm: Arm, among: Iterable[Arm]) -> str:
    """The controller's name, of a plug-in that is called like a kind beside it with a word more."""
    kinds = {one.kind for one in among}
    return f"plug-in {arm.controller}" if arm.kind == PLUGIN and arm.controller in kinds else arm.controller


def _features(arm: Arm) -> dict[str, str]:
    """Everything in which two arms of a controller may differ, by dotted name, as short text."""
    files = {name: sha256[:8] for name, sha256 in arm.files.items()}
    return {**dict(_leaves(arm.settings)), **files, **({"edition": arm.edition} if arm.edition else {})}


def _leaves(value: Any, place: str = "") -> list[tuple[str, str]]:
    if isinstance(value, Mapping):
        return [one for name, item in value.items() for one in _leaves(item, f"{place}.{name}" if place else name)]
    text = value if isinstance(value, str) else json.dumps(value)
    short = len(text) <= _LONGEST_VALUE
    return [(place, text if short else hashlib.sha256(text.encode()).hexdigest()[:8])]


def _leaf(path: str) -> str:
    return path.rpartition(".")[2].replace("_", " ")


def makes_arm(field: str) -> bool:
    """Whether a scenario's field (dotted path) is a part of the arm, and not a condition that it is tested under."""
    block, _, rest = field.partition(".")
    return block == "controller" and rest.partition(".")[0] not in CONDITIONS
