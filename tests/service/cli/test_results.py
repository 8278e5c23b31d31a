"""`needlebench leaderboard`, `dataset --from` and `cite`, over results of short insertions."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

from benchmarks.bundles.check import open_bundle
from benchmarks.suites.catalogue import suite
from service.local import bundle_runs
from service.local.citation import PAPER, TITLE
from simcore.rollout.dataset import VARIABLES, load_dataset
from tests.service.local.bundled import made, needlebench, runs_in

ROOT = Path(__file__).resolve().parents[3]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return runs_in(tmp_path_factory.mktemp("runs"), {"kind": "ifem"}, {"kind": "open_loop"})


@pytest.fixture(scope="module")
def bundle(folder: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("bundle") / "whole.zip"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(bundle_runs, "_l0_ms", lambda _: 0.5)
        made(folder, path, "--sample", "1")
    return path


@pytest.mark.slow
def test_a_site_has_bundles_recordings_and_who_verified_them(bundle: Path, tmp_path: Path) -> None:
    needlebench("bundle", "verify", bundle, "--sample", "1", "--seed", "0", "--by", "A lab")
    told = needlebench("leaderboard", bundle, "--out", tmp_path / "site")
    assert told.exit_code == 0, told.output
    figures = json.loads((tmp_path / "site" / "leaderboard.json").read_text())
    (board,) = figures["boards"]
    (shown,) = board["bundles"]
    assert (tmp_path / "site" / shown["file"]).read_bytes() == bundle.read_bytes()
    with open_bundle(bundle) as opened:
        (name,) = [one.name for one in opened.manifest.files if one.name.endswith(".rrd")]
        recording = opened.archive.read(name, most=10**8)
    assert (tmp_path / "site" / shown["recordings"][0]["file"]).read_bytes() == recording
    assert (shown["verifications"][0]["by"], shown["verifications"][0]["result"]) == ("A lab", "identical")
    assert "A lab" in (tmp_path / "site" / board["file"]).read_text()
    assert needlebench("leaderboard", bundle, "--out", tmp_path / "site").exit_code == 2
    assert needlebench("leaderboard", bundle, "--out", tmp_path / "site", "--force").exit_code == 0


def test_a_changed_bundle_makes_no_site_and_nothing_else_is_replaced(bundle: Path, tmp_path: Path) -> None:
    data = bytearray(bundle.read_bytes())
    data[len(data) // 2] ^= 1
    (tmp_path / "changed.zip").write_bytes(data)
    told = needlebench("leaderboard", tmp_path / "changed.zip", "--out", tmp_path / "site")
    assert (told.exit_code, "was changed" in told.output) == (2, True)
    assert {one.name for one in tmp_path.iterdir()} == {"changed.zip"}
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "thesis.txt").write_text("years of work")
    told = needlebench("leaderboard", bundle, "--out", tmp_path / "mine", "--force")
    assert (told.exit_code, "holds something else than a leaderboard" in told.output) == (2, True)
    assert (tmp_path / "mine" / "thesis.txt").exists()


def test_a_data_set_of_runs_is_what_training_takes(folder: Path, tmp_path: Path) -> None:
    told = needlebench("dataset", "--from", folder, "--arm", "ifem", "--out", tmp_path / "d.npz", "--samples", "20")
    assert told.exit_code == 0, told.output
    data = load_dataset(tmp_path / "d.npz")
    (one,) = data.provenance["insertions"]
    stored = json.loads((folder / "run 0" / "result.json").read_text())
    assert (one["id"], one["arm"], one["digest"]) == ("run 0", "ifem", stored["digest"])
    assert (len(data.drawn), len(data.trajectory)) == (20, stored["metrics"]["steps_completed"])
    trained = needlebench("train", "--data", tmp_path / "d.npz", "--kind", "linear", "--out", tmp_path / "m.json")
    assert trained.exit_code == 0, trained.output


def test_a_table_has_a_row_a_step_and_says_where_it_comes_from(folder: Path, tmp_path: Path) -> None:
    parquet = pytest.importorskip("pyarrow.parquet")
    told = needlebench("dataset", "--from", folder, "--format", "parquet", "--out", tmp_path / "d.parquet")
    assert told.exit_code == 0, told.output
    assert "warning: the insertions differ in controller" in told.output
    table = parquet.read_table(tmp_path / "d.parquet")
    assert set(table.column("insertion").to_pylist()) == {"run 0", "run 1"}
    assert {f"{name}_{axis}" for name in VARIABLES for axis in "xyz"} <= set(table.column_names)
    origin = json.loads(table.schema.metadata[b"provenance"])
    assert [one["arm"] for one in origin["insertions"]] == ["ifem", "open_loop"]


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--insertions", "5"), "--insertions = 5: runs new insertions"),
        (("--arm", "nobody"), "--arm = 'nobody': is none of ifem, open_loop"),
    ],
)
def test_what_does_not_fit_is_refused(folder: Path, tmp_path: Path, options: tuple[str, ...], message: str) -> None:
    told = needlebench("dataset", "--from", folder, "--out", tmp_path / "d.npz", *options)
    assert (told.exit_code, message in told.output) == (2, True)
    told = needlebench("dataset", "--out", tmp_path / "d.npz", "--format", "parquet")
    assert (told.exit_code, "--format = 'parquet': needs --from" in told.output) == (2, True)


def test_a_citation_has_version_commit_and_digests(bundle: Path) -> None:
    from service.local.citation import software

    told = needlebench("cite", "mismatch-v1-smoke", bundle)
    assert told.exit_code == 0
    assert software().version in told.output
    assert str(software().commit) in told.output
    assert suite("mismatch-v1-smoke").sha256 in told.output
    with open_bundle(bundle) as opened:
        assert opened.id in told.output
        assert opened.manifest.suite.sha256 in told.output
    assert needlebench("cite", "mismatch-v9").exit_code == 2


def test_bibtex_has_balanced_braces_and_an_entry_each(bundle: Path) -> None:
    told = needlebench("cite", "--bibtex", "lin100-v2-smoke", bundle).stdout
    assert re.findall(r"^@(\w+)\{([\w-]+),$", told, re.MULTILINE)[:2] == [
        ("software", "needlebench"), ("misc", "needlebench-suite-lin100-v2-smoke"),
    ]  # fmt: skip
    assert told.count("@") == 4
    assert told.count("{") == told.count("}")


def test_the_paper_is_cited_as_the_citation_file_does() -> None:
    text = (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    assert f'title: "{TITLE}"' in text
    assert f"title: {PAPER.title}\n" in text
    assert re.findall(r"family-names: (.+)\n +given-names: (.+)\n", text) == list(PAPER.authors)
    assert f'url: "{PAPER.url}"' in text
    assert f"year: {PAPER.year}\n" in text
    assert f"collection-title: {PAPER.venue}\n" in text
