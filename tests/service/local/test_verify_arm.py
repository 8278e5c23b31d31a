"""A result is verified with the controller that ran, or not at all."""

from __future__ import annotations

import json
import shutil
from typing import TYPE_CHECKING, Any

import pytest

from service.local.verify import CannotVerifyError, check_arm
from simcore import plugins
from simcore.arms import arm_of
from simcore.rollout import artefacts
from simcore.rollout.rollout import run
from simcore.scenario.scenario import Scenario
from tests.service.learned import model_bytes
from tests.service.local.test_verify import SHORT, needlebench
from tests.simcore.controllers.test_plugins import MODULE
from tests.simcore.test_arms import install

if TYPE_CHECKING:
    from pathlib import Path


@pytest.fixture
def stored(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with the result of a plug-in that reads a file; its module lies in `site` beside it."""
    site, folder = tmp_path / "site", tmp_path / "run"
    site.mkdir()
    monkeypatch.syspath_prepend(str(site))
    for name in ("_first", "_loaded"):
        monkeypatch.setattr(plugins, name, {})
    install(site, "verified", {"verified_module.py": MODULE})
    (tmp_path / "table.txt").write_text("1")
    settings = {"table": str(tmp_path / "table.txt")}
    controller = {"kind": "plugin", "name": "verified", "settings": settings}
    artefacts.write(run(Scenario.load({**SHORT, "controller": controller})), folder)
    return folder


def again() -> None:
    """As in a new process."""
    plugins._first.clear()
    plugins._loaded.clear()


def test_the_code_that_ran_is_verified_and_other_code_is_refused(stored: Path) -> None:
    again()
    same = needlebench("verify", str(stored / "result.json"))
    assert (same.exit_code, same.output.splitlines()[0]) == (0, "identical: every bit of every state")
    (stored.parent / "site" / "verified_module.py").write_text(MODULE + "# edited\n")
    again()
    edited = needlebench("verify", str(stored / "result.json"))
    assert edited.exit_code == 2
    assert "controller 'verified' is not the code that ran: then 1.0, code " in edited.output
    assert "install that one to verify the result" in edited.output


def test_another_file_under_the_name_in_its_settings_is_refused(stored: Path) -> None:
    (stored.parent / "table.txt").write_text("2, and more")
    again()
    told = needlebench("verify", str(stored / "result.json"))
    assert told.exit_code == 2
    assert "controller.settings.table names a file that is not the one that was read" in told.output
    (stored.parent / "table.txt").unlink()
    assert "there is none" in needlebench("verify", str(stored / "result.json")).output


def test_code_that_left_no_digest_cannot_be_verified(stored: Path) -> None:
    origin: dict[str, Any] = json.loads((stored / "result.json").read_text())["provenance"]
    now = arm_of(origin["scenario"])
    check_arm(origin, now)
    origin["arm"]["code_sha256"] = None
    with pytest.raises(CannotVerifyError, match="nobody can say what ran"):
        check_arm(origin, now)


def test_a_model_that_was_moved_is_found_by_its_content(tmp_path: Path) -> None:
    from simcore.learning import trained

    model, folder = tmp_path / "mine.json", tmp_path / "run"
    model.write_bytes(model_bytes("linear"))
    artefacts.write(run(Scenario.load({**SHORT, "controller": {"kind": "linear", "model": str(model)}})), folder)
    shutil.move(model, folder / "under another name.json")
    trained._known.clear()
    told = needlebench("verify", str(folder / "result.json"))
    assert (told.exit_code, told.output.splitlines()[0]) == (0, "identical: every bit of every state")
    (folder / "under another name.json").unlink()
    assert "controller.model" in needlebench("verify", str(folder / "result.json")).output
