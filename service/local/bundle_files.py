"""The files that the scenarios of a bundle name, and the same scenarios without paths of this machine."""

from __future__ import annotations

import tempfile
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from benchmarks.bundles.archive import summed
from benchmarks.bundles.canonical import BundleError
from benchmarks.bundles.manifest import FILES, NamedFile
from benchmarks.bundles.named_files import DEFAULT, Named, named_files
from benchmarks.bundles.public_names import PublicNames, is_private, plain_name
from benchmarks.cases import Case, Outcome
from simcore.arms import REMOTE, Arm
from simcore.controller_code import file_sha256
from simcore.errors import ScenarioError
from simcore.file_names import content_in, located, names_mean, with_content
from simcore.learning.trained import PACKAGED
from simcore.remote.link import LOOPBACK

if TYPE_CHECKING:
    from collections.abc import Iterator

    from service.local.insertion_sets import InsertionSet

Json = dict[str, Any]


@dataclass
class BundleFiles:
    """What of an experiment's files goes into its bundle, by the name of the entry; grows as scenarios are read."""

    source: InsertionSet
    contents: dict[str, Path] = field(default_factory=dict)
    entries: dict[str, str] = field(default_factory=dict)  # name in a scenario -> entry
    public: PublicNames = field(default_factory=lambda: PublicNames(private_folders()))
    _found: dict[Named, str] = field(default_factory=dict)

    def outcome(self, outcome: Outcome) -> Outcome:
        """The same insertion, with public names. Raises BundleError for a file that is not here any more."""
        provenance = outcome.result.get("provenance") or {}
        arm = Arm.of_data(provenance["arm"]) if "arm" in provenance else None
        for named in named_files(outcome.case.scenario, arm):
            self._add(outcome.case.id, named)
        scenario = self.public.value(outcome.case.scenario)
        if (scenario.get("controller") or {}).get("kind") == REMOTE:
            scenario["controller"]["address"] = LOOPBACK
        result = self.public.value({**outcome.result, "provenance": {}})
        shown = {**provenance, "scenario": scenario}
        if arm is not None:
            shown["arm"] = replace(arm, settings=self.public.value(arm.settings)).data()
        case = Case(outcome.case.id, scenario, self.public.value(outcome.case.labels))
        return Outcome(case, {**result, "provenance": shown})

    def _add(self, case_id: str, named: Named) -> None:
        if named in self._found:
            return
        with names_mean(self.source.lookup), content_in(*self.source.folders):
            file = _file(named)
        if file is None:
            message = f"{named.field} = {named.name!r}: the file with SHA-256 {named.sha256[:12]} is not here any more"
            raise BundleError(f"{case_id}: {message}")
        sha256 = summed(file)[2]
        title = file.name if named.name == DEFAULT else named.name
        entry = self._found[named] = f"{FILES}/{sha256[:12]}-{plain_name(title)}"
        self.contents[entry] = file.absolute()
        name = self.public.name(named.name, sha256) if is_private(named.name) else named.name
        if name != DEFAULT and self.entries.setdefault(name, entry) != entry:
            raise BundleError(f"{case_id}: {named.field} = {named.name!r} is the name of two different files")

    def listed(self) -> list[NamedFile]:
        """For the manifest."""
        return [NamedFile(name=name, entry=entry) for name, entry in sorted(self.entries.items())]

    @property
    def by_name(self) -> dict[str, Path]:
        """Public name -> file."""
        return {name: self.contents[entry] for name, entry in self.entries.items()}

    def lookup(self, name: str) -> Path:
        """What a public name means while runs are made again for the bundle."""
        return self.contents[self.entries[name]] if name in self.entries else self.source.lookup(name)


def _file(named: Named) -> Path | None:
    """The file with the content that was read then; None if it is not found."""
    if named.name != DEFAULT:
        try:
            file = located(named.field, named.name)
            if file.is_file() and named.sha256 in (file_sha256(file), summed(file)[2]):
                return file
        except (ScenarioError, OSError):
            pass
    return with_content(named.sha256, Path(named.name).suffix or ".json", PACKAGED)


def private_folders() -> list[str]:
    """Paths of this machine that are taken out wherever they stand: of this folder, the home, scratch files."""
    known = (Path.cwd(), Path.home(), Path(tempfile.gettempdir()))
    return sorted({str(one) for one in known if len(one.parts) > 1}, key=len, reverse=True)


def private_lines(text: bytes) -> Iterator[int]:
    """Numbers of the lines that name a folder of this machine, from 1."""
    folders = [one.encode() for one in private_folders()]
    for number, line in enumerate(text.splitlines(), start=1):
        if any(folder in line for folder in folders):
            yield number
