"""What an arm is: the same controller, settings, code and files are one arm; anything else is another."""

from __future__ import annotations

import functools
import hashlib
import json
from typing import TYPE_CHECKING, Any

import pytest

from simcore import plugins
from simcore.arms import Arm, arm_names, arm_of
from simcore.controller_code import Code, code_of_factory
from simcore.file_names import names_mean, nothing
from simcore.learning.trained import PACKAGED
from simcore.provenance import provenance
from simcore.scenario.scenario import Scenario
from tests.simcore.controllers.test_plugins import MODULE

if TYPE_CHECKING:
    from pathlib import Path


def arm(block: dict[str, Any], **more: Any) -> Arm:
    return arm_of(Scenario.load({"controller": block, **more}).resolved())


def plugin(name: str, **settings: Any) -> Arm:
    return arm({"kind": "plugin", "name": name, "settings": settings})


@pytest.fixture
def site(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    folder = tmp_path / "site"
    folder.mkdir()
    monkeypatch.syspath_prepend(str(folder))
    monkeypatch.setattr(plugins, "_first", {})
    monkeypatch.setattr(plugins, "_loaded", {})
    return folder


def install(
    folder: Path, name: str, files: dict[str, str], *, version: str = "1.0", recorded: tuple[str, ...] = ()
) -> None:
    """As pip would: with a RECORD of these files, or editable without."""
    for place, text in files.items():
        (folder / place).parent.mkdir(parents=True, exist_ok=True)
        (folder / place).write_text(text)
    info = folder / f"{name}-{version}.dist-info"
    info.mkdir(exist_ok=True)
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: {version}\n")
    module = next(iter(files)).partition("/")[0].removesuffix(".py")
    (info / "entry_points.txt").write_text(f"[{plugins.GROUP}]\n{name} = {module}:Still\n")
    (info / "RECORD").write_text("".join(f"{place},,\n" for place in recorded))


def test_two_plugins_and_two_settings_are_two_arms_each(site: Path) -> None:
    install(site, "one", {"one_module.py": MODULE})
    install(site, "other", {"other_module.py": MODULE + "# the same class\n"})
    arms = [plugin("one"), plugin("other"), plugin("one", gain=0.5), plugin("one", gain=0.7)]
    assert len({each.id for each in arms}) == 4
    assert plugin("one").id == arms[0].id
    assert list(arm_names(arms[2:]).values()) == ["one gain 0.5", "one gain 0.7"]
    assert sorted(arm_names(arms).values()) == ["one", "one gain 0.5", "one gain 0.7", "other"]


def test_what_degrades_every_controller_is_no_part_of_an_arm() -> None:
    assert arm({"kind": "ifem"}).id == arm({"kind": "ifem", "delay_s": 0.1}).id
    assert arm({"kind": "ifem"}).id != arm({"kind": "ifem", "gain": 0.5}).id
    separate = {"kind": "ifem", "model": {"kind": "separate"}}
    spacings = [arm(separate, interaction={"spacing_mm": mm}).id for mm in (5, 6)]
    assert spacings[0] == spacings[1] != arm({"kind": "ifem"}).id


def test_a_model_counts_by_its_content_whatever_it_is_called(tmp_path: Path) -> None:
    copy = tmp_path / "copy.json"
    copy.write_bytes((PACKAGED / "elm.json").read_bytes())
    named, bundled = arm({"kind": "elm", "model": str(copy)}), arm({"kind": "elm"})
    assert named == bundled
    assert named.files == {"model": hashlib.sha256(copy.read_bytes()).hexdigest()}


def test_poses_count_by_their_content() -> None:
    poses = [[18.0, 31.0, z, 1.0, 0.0, 0.0, 0.0] for z in (-180.0, -179.9)]
    moved = [*poses[:1], [18.1, *poses[1][1:]]]
    assert arm({"kind": "replay", "poses": poses}).id != arm({"kind": "replay", "poses": moved}).id
    assert len(json.dumps(arm({"kind": "replay", "poses": poses * 50}).data())) < 500


def test_the_code_of_a_local_package_is_all_of_its_files(site: Path) -> None:
    install(site, "mine", {"mine_package/__init__.py": MODULE, "mine_package/deep/law.py": "GAIN = 1\n"})
    before = plugin("mine")
    assert (before.version, before.code_sha256 is not None) == ("1.0", True)
    (site / "mine_package" / "__pycache__").mkdir()
    (site / "mine_package" / "__pycache__" / "law.pyc").write_bytes(b"x")
    assert plugin("mine").id == before.id
    (site / "mine_package" / "deep" / "law.py").write_text("GAIN = 2\n")
    assert arm_of({"controller": {"kind": "plugin", "name": "mine"}}).id != before.id


def test_the_code_of_a_lone_module_has_what_it_imports_from_its_folder(site: Path) -> None:
    install(site, "lone", {"lone.py": f"import beside\n{MODULE}", "beside.py": "import further", "further.py": ""})
    (site / "stranger.py").write_text("")
    before = plugin("lone").code_sha256
    (site / "stranger.py").write_text("changed = True")
    assert plugin("lone").code_sha256 == before
    (site / "further.py").write_text("changed = True")
    assert arm_of({"controller": {"kind": "plugin", "name": "lone"}}).code_sha256 != before


def test_the_code_of_an_installed_distribution_is_what_its_record_lists(site: Path) -> None:
    files = {"wheel_module.py": MODULE, "wheel_data/table.txt": "1"}
    install(site, "wheel", files, recorded=(*files, "wheel-1.0.dist-info/RECORD"))
    before = plugin("wheel").code_sha256
    (site / "wheel_data" / "table.txt").write_text("2")
    assert arm_of({"controller": {"kind": "plugin", "name": "wheel"}}).code_sha256 != before


def test_what_runs_is_the_code_that_was_loaded(site: Path) -> None:
    install(site, "edited", {"edited_module.py": MODULE})
    before = plugin("edited").id
    plugins.factory_of("edited")
    (site / "edited_module.py").write_text(MODULE + "# later\n")
    assert arm_of({"controller": {"kind": "plugin", "name": "edited"}}).id == before


def test_a_file_that_the_settings_name_counts_by_its_content(site: Path, tmp_path: Path) -> None:
    install(site, "reads", {"reads_module.py": MODULE})
    file = tmp_path / "weights.bin"
    file.write_bytes(b"1")
    before = plugin("reads", model={"file": str(file), "words": ["no such file", "\0"]})
    assert before.files == {"model.file": hashlib.sha256(b"1").hexdigest()}
    file.write_bytes(b"22")
    assert plugin("reads", model={"file": str(file)}).files != before.files
    with names_mean(nothing):  # a service tells nobody what is on its disk
        assert plugin("reads", model={"file": str(file)}).files == {}


class Registered:
    def __init__(self, *_: Any) -> None: ...


def test_what_a_program_registers_has_the_code_of_its_module() -> None:
    assert code_of_factory(Registered) == code_of_factory(functools.partial(Registered, 1))
    assert code_of_factory(Registered).sha256 is not None
    cell = type("Cell", (), {"__module__": "a_notebook"})
    assert code_of_factory(cell) == Code(None, None)


def test_names_tell_arms_apart_and_are_short(site: Path) -> None:
    install(site, "elm", {"elm_module.py": MODULE})
    install(site, "long", {"long_module.py": MODULE})
    arms = [arm({"kind": "elm"}), plugin("elm"), plugin("long", table=[1] * 100), plugin("long", table=[2] * 100)]
    names = list(arm_names(arms).values())
    assert names[:2] == ["elm", "plug-in elm"]
    assert len(set(names)) == 4
    assert max(map(len, names)) < 24


def test_a_result_says_what_ran_and_it_reads_back() -> None:
    scenario = Scenario.load({"controller": {"kind": "ifem", "gain": 0.5}}).resolved()
    data = json.loads(json.dumps(provenance(scenario)["arm"]))
    assert Arm.of_data(data) == arm_of(scenario)
    assert data["id"] == arm_of(scenario).id
