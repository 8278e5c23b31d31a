"""Records the git commit in what is built, so that results of an installed package name their code.

The file is `simcore/_commit.txt`: one line, the full hash, with `-dirty` behind it if tracked files changed.
It is left out of editable installations (the checkout answers there) and where no commit is known.
"""

from __future__ import annotations

import os
import subprocess
import tempfile
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

COMMIT_FILE = "simcore/_commit.txt"


def git(root: Path, *arguments: str) -> str | None:
    """What git answers there, None if there is no git or no repository whose top is `root`."""
    if not (root / ".git").exists():
        return None
    try:
        done = subprocess.run(["git", *arguments], cwd=root, capture_output=True, text=True, check=True)
    except (OSError, subprocess.CalledProcessError):
        return None
    return done.stdout.strip()


def commit_of(root: Path) -> str | None:
    """The commit: from NEEDLEBENCH_COMMIT, else git, else the file that a source archive carries."""
    given = os.environ.get("NEEDLEBENCH_COMMIT", "").strip()
    if given:
        return given
    head = git(root, "rev-parse", "HEAD")
    if head:
        return head + ("-dirty" if git(root, "status", "--porcelain", "--untracked-files=no") else "")
    carried = root / COMMIT_FILE
    return carried.read_text(encoding="utf-8").strip() if carried.exists() else None


class CommitHook(BuildHookInterface):  # type: ignore[type-arg]
    """Adds the commit file to wheel and source archive without writing into the checkout."""

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Called by hatchling before it collects the files."""
        self.folder = tempfile.TemporaryDirectory()
        commit = None if version == "editable" else commit_of(Path(self.root))
        if commit:
            source = Path(self.folder.name) / "commit.txt"
            source.write_text(commit + "\n", encoding="utf-8")
            build_data["force_include"][str(source)] = COMMIT_FILE

    def finalize(self, version: str, build_data: dict[str, Any], artifact_path: str) -> None:
        """Called by hatchling when the archive is written."""
        self.folder.cleanup()
