"""What a bundle says of itself: manifest.json, whose SHA-256 is the bundle's id."""

from __future__ import annotations

import hashlib
import json
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, StringConstraints, ValidationError

from benchmarks.bundles.canonical import BundleError, canonical, read_canonical
from simcore.arms import Arm

SCHEMA: Literal["needlebench/bundle/1"] = "needlebench/bundle/1"
CASES, RESULTS = "cases.jsonl", "results.csv"
SERIES, RECORDINGS, FILES, SOURCE = "series", "recordings", "files", "source"
ORIGIN = (  # of a result's provenance: the code and the machine that made it, without names
    "commit",
    "versions",
    "platform",
    "cpu",
    "cpu_count",
    "llvm_cpu",
    "llvm_features",
    "blas_core",
    "blas_version",
    "threads",
    "byte_order",
)

Sha256 = Annotated[str, StringConstraints(pattern=r"^[0-9a-f]{64}$")]
Text = Annotated[str, StringConstraints(max_length=2000)]
Count = Annotated[int, Field(ge=0, le=10**9)]
Json = dict[str, Any]


class Part(BaseModel):
    """A part of a manifest."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, hide_input_in_errors=True)


class SuiteRecord(Part):
    """The cases. sha256: as of a `benchmarks.cases.Suite`; tasks_sha256: of what they ask of any controller."""

    name: Text
    sha256: Sha256
    tasks_sha256: Sha256
    cases: Count


class SourceFile(Part):
    """A file of a plug-in's code. name: as its digest counts it. entry: where the bundle holds it; None for what lies
    outside of the package, such as an installed script."""

    name: Text
    sha256: Text
    entry: Text | None


class ArmRecord(Part):
    """An arm as the cases were steered by it, see `simcore.arms`. settings: as JSON text, so that 1.0 stays 1.0, as the
    arm's digest has it. source: of a plug-in, with its entry point."""

    id: Text
    kind: Text
    controller: Text
    settings: Annotated[str, StringConstraints(max_length=200_000)]
    version: Text | None
    code_sha256: Text | None
    files: dict[str, Text]
    cases: Count
    entry_point: Text | None = None
    source: list[SourceFile] | None = None

    def arm(self) -> Arm:
        """As the code has it. Raises BundleError for settings that are no JSON object."""
        try:
            settings = json.loads(self.settings)
        except (ValueError, RecursionError):
            settings = None
        if not isinstance(settings, dict):
            raise BundleError(f"{self.id}: its settings are no JSON object")
        return Arm.of_data({**self.model_dump(), "settings": settings})


class Origin(Part):
    """Code and machine of some of the cases; what their results did not say is None."""

    cases: Count
    commit: Text | None = None
    versions: dict[str, Text] = {}
    platform: Text | None = None
    cpu: Text | None = None
    cpu_count: int | None = None
    llvm_cpu: Text | None = None
    llvm_features: Annotated[str, StringConstraints(max_length=20_000)] | None = None
    blas_core: Text | None = None
    blas_version: Text | None = None
    threads: int | None = None
    byte_order: Text | None = None


class Maker(Part):
    """What wrote the bundle. lock_sha256: of the locked requirements; None outside of a checkout."""

    version: Text
    commit: Text | None
    lock_sha256: Sha256 | None


class Choice(Part):
    """The cases whose full series are within. asked: how many were to be chosen by the seed; cases: those of them
    that could be run again when the bundle was made."""

    seed: int
    asked: Count
    cases: list[Text]


class Timing(Part):
    """One L0 in ms, measured when the bundle was made, on this processor."""

    l0_ms: Annotated[float, Field(gt=0.0, lt=1e6)]
    cpu: Text


class Warned(Part):
    """A warning of the insertions: of how many, and some of their ids."""

    text: Annotated[str, StringConstraints(max_length=20_000)]
    cases: Count
    first: list[Text]


class NamedFile(Part):
    """A file that scenarios name. name: as they do; entry: where the bundle holds it."""

    name: Text
    entry: Text


class FileRecord(Part):
    """A file of the bundle."""

    name: Text
    bytes: Count
    sha256: Sha256


class Manifest(Part):
    """All of it. renamed: how many names of files were replaced, because they were paths of a machine."""

    schema_: Literal["needlebench/bundle/1"] = Field(alias="schema")
    division: Literal["closed", "open"]
    suite: SuiteRecord
    arms: list[ArmRecord]
    origins: list[Origin]
    made_with: Maker
    chosen: Choice
    timing: Timing | None
    warnings: list[Warned]
    failed: Count
    named_files: list[NamedFile]
    renamed: Count
    files: list[FileRecord]

    def data(self) -> Json:
        """As JSON data."""
        return self.model_dump(mode="json", by_alias=True)

    def text(self) -> bytes:
        """The content of manifest.json."""
        return canonical(self.data())

    @property
    def id(self) -> str:
        """SHA-256 of the canonical text."""
        return hashlib.sha256(self.text()).hexdigest()

    def case_of(self, entry: str) -> str:
        """The case that a series or a recording belongs to."""
        return entry.partition("/")[2].rpartition(".")[0]

    def has(self, name: str) -> bool:
        """Whether the bundle holds a file."""
        return any(file.name == name for file in self.files)


def read_manifest(data: bytes, name: str) -> Manifest:
    """The manifest that a text says. Raises BundleError for one that is not canonical, or says something else."""
    value = read_canonical(data, name)
    if not isinstance(value, dict) or value.get("schema") != SCHEMA:
        found = value.get("schema") if isinstance(value, dict) else type(value).__name__
        raise BundleError(f"{name} is not of {SCHEMA}: its schema is {str(found)[:60]!r}")
    try:
        manifest = Manifest.model_validate(value)
    except (ValidationError, RecursionError) as error:
        raise BundleError(f"{name}: {_first(error)}") from None
    if manifest.text() != data:
        raise BundleError(f"{name} leaves out fields of {SCHEMA}")
    return manifest


def _first(error: ValidationError | RecursionError) -> str:
    if isinstance(error, RecursionError):
        return "is nested too deeply"
    fault = error.errors(include_url=False, include_input=False)[0]
    return f"{'.'.join(str(part) for part in fault['loc'])}: {fault['msg']}"
