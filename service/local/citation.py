"""Citations: the software with version and commit, the paper, suites by their digests, bundles by their ids."""

from __future__ import annotations

from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, metadata
from typing import TYPE_CHECKING

from benchmarks.bundles.check import open_bundle
from benchmarks.suites.catalogue import suite
from service.version import installed_version
from simcore.provenance import commit

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

TITLE = "needlebench: reproducible benchmarks for robotic needle steering in deforming tissue"
AUTHORS = "The needlebench developers"
LICENSE = "Apache-2.0"


@dataclass(frozen=True)
class Paper:
    """The paper whose model, controller and experiments are reproduced; as CITATION.cff has it."""

    authors: tuple[tuple[str, str], ...]  # family name, given names
    title: str
    venue: str
    place: str
    year: int
    url: str


PAPER = Paper(
    authors=(
        ("Suruagy Perrusi", "Pedro Henrique"),
        ("Cazzaniga", "Anna"),
        ("Baksic", "Paul"),
        ("Tagliabue", "Eleonora"),
        ("de Momi", "Elena"),
        ("Courtecuisse", "Hadrien"),
    ),
    title="Learning robotic needle steering from inverse finite element simulations",
    venue="ICRA 2021 Workshop on Representing and Manipulating Deformable Objects",
    place="Xi'an, China",
    year=2021,
    url="https://hal.archives-ouvertes.fr/hal-03241674",
)


@dataclass(frozen=True)
class Cited:
    """A suite or a bundle. key: of its BibTeX entry. text: what identifies it."""

    key: str
    title: str
    text: str


@dataclass(frozen=True)
class Software:
    """This installation. commit: None where it is unknown."""

    version: str
    commit: str | None
    license: str

    @property
    def edition(self) -> str:
        """As in "version 0.1.0, commit 3f2a90c1"."""
        return f"version {self.version}" + (f", commit {self.commit}" if self.commit else "")


def software() -> Software:
    """What is installed here."""
    try:
        known = metadata("needlebench")
        terms = known["License-Expression"] or LICENSE
    except PackageNotFoundError:
        terms = LICENSE
    return Software(installed_version(), commit(), terms)


def cited_suite(name: str) -> Cited:
    """A named suite. Raises ScenarioError for an unknown one."""
    found = suite(name)
    text = f"{len(found.cases)} cases, SHA-256 {found.sha256}"
    return Cited(f"needlebench-suite-{name}", f"needlebench suite {name}: {found.title}", text)


def cited_bundle(path: Path) -> Cited:
    """A bundle, which is checked. Raises BundleError."""
    with open_bundle(path) as bundle:
        manifest = bundle.manifest
    commits = ", ".join(dict.fromkeys(one.commit or "unknown" for one in manifest.origins)) or "unknown"
    known = f"suite SHA-256 {manifest.suite.sha256}, {manifest.suite.cases} cases run by commit {commits}"
    title = f"needlebench bundle of {manifest.suite.name}"
    return Cited(f"needlebench-bundle-{manifest.id[:8]}", title, f"id {manifest.id}, {known}")


def as_text(known: Software, items: Sequence[Cited]) -> str:
    """A paragraph each, to be put into a list of references."""
    names = [f"{given} {family}" for family, given in PAPER.authors]
    paper = f"{', '.join(names)}. {PAPER.title}. {PAPER.venue}, {PAPER.place}, {PAPER.year}. {PAPER.url}"
    lines = [f"{AUTHORS}. {TITLE}. {known.edition[0].upper()}{known.edition[1:]}. {known.license}."]
    lines += [f"{item.title}. {item.text}." for item in items]
    return "\n\n".join([*lines, f"The method is that of: {paper}"])


def as_bibtex(known: Software, items: Sequence[Cited]) -> str:
    """An entry each."""
    entries = [
        _entry("software", "needlebench", author=f"{{{AUTHORS}}}", title=f"{{{TITLE}}}", version=known.version,
               note=known.edition, license=known.license),
        *(_entry("misc", item.key, author=f"{{{AUTHORS}}}", title=f"{{{item.title}}}", note=item.text)
          for item in items),
        _entry("inproceedings", "perrusi2021learning",
               author=" and ".join(f"{family}, {given}" for family, given in PAPER.authors), title=f"{{{PAPER.title}}}",
               booktitle=PAPER.venue, address=PAPER.place, year=str(PAPER.year), url=PAPER.url),
    ]  # fmt: skip
    return "\n\n".join(entries)


def _entry(kind: str, key: str, **fields: str) -> str:
    lines = [f"  {name} = {{{_escaped(value)}}}," for name, value in fields.items()]
    return "\n".join([f"@{kind}{{{key},", *lines, "}"])


def _escaped(text: str) -> str:
    """Signs that TeX reads as something else; braces stay, which are ours."""
    for sign in "&%$#_":
        text = text.replace(sign, f"\\{sign}")
    return text.replace("+-", "$\\pm$").replace("~", "\\textasciitilde{}")
