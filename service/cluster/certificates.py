"""Keys for a cluster of one user: who holds the folder may join it, everybody else gets no answer."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING

from distributed.security import Security

from service.cluster.address import CERTIFICATE, FIELD, KEY
from service.files.private import private_files, private_folder
from simcore.errors import Problem, ScenarioError

if TYPE_CHECKING:
    from pathlib import Path


def make_certificates(folder: Path) -> None:
    """A new key and a certificate that it signed itself, valid for a year, which no other account can read."""
    private_folder(folder)
    made = Security.temporary()
    with private_files():
        for name, text in ((KEY, made.tls_scheduler_key), (CERTIFICATE, made.tls_scheduler_cert)):
            draft = folder / f".{name}.{os.getpid()}"
            draft.write_text(text)
            draft.replace(folder / name)


def security_of(folder: Path | None) -> Security:
    """For TLS with the key in a folder, both sides checked; without one Dask's own configuration. Raises
    ScenarioError for a folder without it."""
    if folder is None:
        return Security()
    key, certificate = folder / KEY, folder / CERTIFICATE
    for file in (key, certificate):
        if not file.is_file():
            raise ScenarioError([Problem(FIELD, str(folder), f"has no {file.name}")])
    mine = {"key": str(key), "cert": str(certificate)}
    roles = {f"tls_{role}_{part}": name for role in ("client", "scheduler", "worker") for part, name in mine.items()}
    return Security(require_encryption=True, tls_ca_file=str(certificate), **roles)
