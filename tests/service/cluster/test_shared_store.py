"""What workers leave on the shared disk: attempts have numbers of their own, and the first end of a case counts."""

from __future__ import annotations

import threading
from typing import TYPE_CHECKING, Any

import pytest

from service.cluster import shared_store
from service.cluster.shared_store import SharedStore, StoreError

if TYPE_CHECKING:
    from pathlib import Path


@pytest.fixture
def store(tmp_path: Path) -> SharedStore:
    made = SharedStore(tmp_path / "store")
    made.open()
    return made


def ended(store: SharedStore, folder: Path, number: int, text: str) -> dict[str, Any]:
    """How attempt `number` of the case k ended, with a series of this text."""
    source = folder / "k.npz"
    source.write_text(text)
    files = {source.name: store.keep_file(source, "k", number)}
    return {"error": None, "result": {"attempt": number}, "files": files, "cost": {"attempts": number}}


def test_every_attempt_has_a_number_of_its_own(store: SharedStore) -> None:
    numbers: list[int] = []
    threads = [threading.Thread(target=lambda: numbers.append(store.begin("k", "a worker"))) for _ in range(20)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert sorted(numbers) == list(range(1, 21))
    store.give_back("k", 7)
    assert store.begin("k", "another") == 7
    assert store.begin("another case", "a worker") == 1


def test_the_first_attempt_that_ends_counts(store: SharedStore, tmp_path: Path) -> None:
    first = ended(store, tmp_path, 1, "first")
    second = ended(store, tmp_path, 2, "second")
    assert store.publish("k", second)["result"] == {"attempt": 2}
    assert store.publish("k", first)["result"] == {"attempt": 2}  # too late
    assert store.keys() == {"k"}
    home = tmp_path / "home"
    home.mkdir()
    assert store.take("k", home)["result"] == {"attempt": 2}
    assert (home / "k.npz").read_text() == "second"
    assert not list((store.path / "files").iterdir())  # the late one took its file with it
    assert store.take("k", home)["result"] == {"attempt": 2}  # once more, as after a kill in between
    store.forget("k", 2)
    assert store.keys() == set()
    assert not list((store.path / "attempts").iterdir())


def test_a_result_whose_file_is_gone_is_not_taken(
    store: SharedStore, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(shared_store, "_PATIENCE_S", 0.1)
    store.publish("k", ended(store, tmp_path, 1, "text"))
    for file in (store.path / "files").iterdir():
        file.unlink()
    (tmp_path / "home").mkdir()
    (tmp_path / "home" / "k.npz").write_text("of something else")
    with pytest.raises(StoreError, match="the result k was reported by a worker and is not to be seen here"):
        store.take("k", tmp_path / "home")


def test_a_store_on_another_disk_is_noticed(
    store: SharedStore, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(shared_store, "_PATIENCE_S", 0.1)
    token = store.open()
    assert store.shows(token)
    assert not SharedStore(tmp_path / "nowhere").shows(token)
    store.open()
    assert not store.shows(token)


def test_results_stay_and_attempts_are_counted_anew(store: SharedStore, tmp_path: Path) -> None:
    store.begin("k", "a worker")
    store.publish("k", ended(store, tmp_path, 1, "text"))
    store.open()
    assert store.keys() == {"k"}
    assert store.begin("k", "a worker") == 1
