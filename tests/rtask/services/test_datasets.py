"""Datasets: versions that never change, forks, merges with each kind of conflict, privacy."""

from __future__ import annotations

import itertools
from pathlib import Path

import pytest

from rtask.errors import (
    ConflictError,
    ForbiddenError,
    UnknownTermError,
    UsageError,
    VersionConflictError,
)
from rtask.kb.commit.access import Access
from rtask.kb.durability.blobs import BlobStore
from rtask.services.datasets.store import Datasets

ALICE, BOB = Access("alice", "robot"), Access("bob", "robot")


@pytest.fixture
def datasets(tmp_path: Path) -> Datasets:
    return Datasets(tmp_path / "datasets")


def made(datasets: Datasets, name: str, files: dict[str, bytes]) -> None:
    datasets.create(name)
    datasets.put(name, files)
    datasets.snapshot(name)


def contents(datasets: Datasets, name: str) -> dict[str, bytes]:
    return {path: datasets.read(name, path) for path in datasets.find(name).files}


def test_a_version_stays_as_it_was_while_the_head_changes(datasets):
    made(datasets, "lab/A", {"x": b"1", "sub/y": b"2"})
    datasets.put("lab/A", {"x": b"3"})
    datasets.remove("lab/A", ["/sub"])
    assert contents(datasets, "lab/A@1") == {"x": b"1", "sub/y": b"2"}
    assert contents(datasets, "lab/A@head") == {"x": b"3"}
    assert datasets.snapshot("lab/A").number == 2
    assert datasets.snapshot("lab/A").number == 2, "nothing changed since"
    assert datasets.find("lab/A").number == 2
    difference = datasets.difference("lab/A@1", "lab/A@2")
    assert difference == {"added": [], "removed": ["sub/y"], "changed": ["x"]}


def test_what_was_stored_is_there_after_opening_again(datasets, tmp_path):
    made(datasets, "lab/A", {"x": b"1"})
    again = Datasets(tmp_path / "datasets")
    assert contents(again, "lab/A@1") == {"x": b"1"}


@pytest.mark.parametrize(
    ("ours", "theirs", "kind"),
    [
        ({"x": b"mine"}, {"x": b"other"}, "both_changed"),
        ({"x": None}, {"x": b"other"}, "changed_and_deleted"),
        ({"x": b"mine"}, {"x": None}, "changed_and_deleted"),
        ({"new": b"file"}, {"new/inner": b"folder"}, "file_against_folder"),
    ],
)
def test_each_conflict_is_named_and_leaves_everything_as_it_was(datasets, ours, theirs, kind):
    made(datasets, "lab/A", {"x": b"1", "y": b"1"})
    datasets.fork("lab/B", "lab/A@1")
    for name, changes in (("lab/A", ours), ("lab/B", theirs)):
        datasets.put(name, {path: data for path, data in changes.items() if data is not None})
        datasets.remove(name, [path for path, data in changes.items() if data is None])
        datasets.snapshot(name)
    before = contents(datasets, "lab/A@head")
    with pytest.raises(ConflictError, match=kind) as caught:
        datasets.merge("lab/A", "lab/B@1")
    assert caught.value.details["conflicts"] == [{"path": next(iter(ours)), "kind": kind}]
    assert contents(datasets, "lab/A@head") == before
    theirs_after = contents(datasets, "lab/B@1")
    datasets.merge("lab/A", "lab/B@1", {"": "theirs"})
    assert contents(datasets, "lab/A") == theirs_after


@pytest.mark.slow
def test_merges_in_any_order_have_the_same_result(datasets):
    made(datasets, "lab/A", {f"f{k}": b"0" for k in range(6)})
    forks = ("lab/B", "lab/C", "lab/D")
    for number, name in enumerate(forks):
        datasets.fork(name, "lab/A@1")
        datasets.put(name, {f"f{number}": name.encode(), f"of/{name}": b"new"})
        datasets.snapshot(name)
    results = []
    for number, order in enumerate(itertools.permutations(forks)):
        target = f"lab/T{number}"
        datasets.fork(target, "lab/A@1")
        for name in order:
            datasets.merge(target, f"{name}@1")
        results.append(datasets.find(target).digest)
    assert len(set(results)) == 1


def test_merging_again_what_was_merged_changes_nothing(datasets):
    made(datasets, "lab/A", {"x": b"1"})
    datasets.fork("lab/B", "lab/A@1")
    datasets.put("lab/B", {"x": b"2"})
    datasets.snapshot("lab/B")
    first = datasets.merge("lab/A", "lab/B@1")
    datasets.put("lab/A", {"x": b"3"})
    assert contents(datasets, datasets.merge("lab/A", "lab/B@1").name) == {"x": b"3"}
    assert first.parents == ("lab/A@1", "lab/B@1")


def test_a_private_dataset_looks_to_strangers_as_if_it_did_not_exist(datasets):
    datasets.create("lab/Secret", ALICE, readers=[])
    datasets.put("lab/Secret", {"x": b"1"}, ALICE)
    datasets.snapshot("lab/Secret", access=ALICE)
    datasets.fork("lab/Copy", "lab/Secret@1", ALICE)
    assert datasets.read("lab/Secret", "x", ALICE) == b"1"
    for name in ("lab/Secret", "lab/Copy", "lab/Secret@1"):
        with pytest.raises(UnknownTermError) as hidden:
            datasets.find(name, BOB)
        with pytest.raises(UnknownTermError) as missing:
            datasets.find(name.replace("Secret", "Qqqqqq").replace("Copy", "Qqqqqq"), BOB)
        plain = name.partition("@")[0]
        assert str(hidden.value) == str(missing.value).replace("lab/Qqqqqq", plain)
    assert datasets.names(BOB) == []
    assert datasets.names(ALICE) == ["lab/Copy", "lab/Secret"]


def test_creating_a_dataset_does_not_tell_which_private_names_are_taken(datasets):
    datasets.create("lab/Secret", ALICE, readers=[])
    refusals = set()
    for name in ("lab/Secret", "lab/Free"):
        with pytest.raises(ForbiddenError, match="belongs to somebody else") as refused:
            datasets.create(name, BOB)
        refusals.add(str(refused.value))
    assert len(refusals) == 1
    datasets.create("bob/Parts", BOB)
    datasets.create("lab/More", ALICE)
    assert datasets.names(BOB) == ["bob/Parts", "lab/More"]


def test_a_dataset_cannot_be_private_where_others_keep_theirs(datasets):
    datasets.create("lab/Parts", ALICE)
    with pytest.raises(ConflictError, match="use a namespace of your own"):
        datasets.create("lab/Mine", BOB, readers=[])
    datasets.create("lab/Mine", BOB)


def test_only_the_owner_writes(datasets):
    datasets.create("lab/A", ALICE)
    datasets.put("lab/A", {"x": b"1"}, ALICE)
    for change in (
        lambda: datasets.put("lab/A", {"x": b"2"}, BOB),
        lambda: datasets.remove("lab/A", ["x"], BOB),
        lambda: datasets.snapshot("lab/A", access=BOB),
    ):
        with pytest.raises(ForbiddenError, match="belongs to alice; fork it"):
            change()
    assert contents(datasets, "lab/A@head") == {"x": b"1"}


def test_a_guarded_write_notices_that_somebody_was_faster(datasets):
    datasets.create("lab/A")
    datasets.put("lab/A", {"x": b"1"})
    digest = datasets.find("lab/A@head").files["x"].sha256
    datasets.put("lab/A", {"x": b"2"}, if_match=f'"{digest}"')
    with pytest.raises(VersionConflictError, match="changed in the meantime"):
        datasets.put("lab/A", {"x": b"3"}, if_match=digest)


@pytest.mark.parametrize("path", ["", "/", "../x", "a/../b", "a//b", "a\\b", "x" * 500])
def test_a_path_that_is_none_is_refused(datasets, path):
    datasets.create("lab/A")
    with pytest.raises(UsageError, match="path"):
        datasets.put("lab/A", {path: b""})


@pytest.mark.parametrize("name", ["A", "lab/", "blobs/x", "views/x", "../a/b", "lab/A/B"])
def test_a_name_that_is_none_is_refused(datasets, name):
    with pytest.raises(UsageError, match="expected <namespace>/<name>"):
        datasets.create(name)


def test_a_file_and_a_folder_cannot_share_a_name(datasets):
    made(datasets, "lab/A", {"a": b""})
    with pytest.raises(ConflictError, match="a folder and a file"):
        datasets.put("lab/A", {"a/b": b""})


def test_a_scratch_copy_is_thrown_away(datasets):
    made(datasets, "lab/A", {"x": b"1"})
    with datasets.scratch("lab/A") as folder:
        (folder / "x").write_bytes(b"changed")
        (folder / "new").write_bytes(b"more")
    assert not folder.exists()
    assert contents(datasets, "lab/A") == {"x": b"1"}


def test_a_view_is_made_once_for_the_same_contents(datasets):
    made(datasets, "lab/A", {"sub/x": b"1"})
    datasets.fork("lab/B", "lab/A@1")
    datasets.snapshot("lab/B")
    view = datasets.view(datasets.find("lab/A"))
    assert (view / "sub" / "x").read_bytes() == b"1"
    assert datasets.view(datasets.find("lab/B")) == view


def test_many_blobs_are_stored_at_once_and_are_sound(tmp_path):
    store = BlobStore(tmp_path)
    data = [str(k % 40).encode() for k in range(60)]
    blobs = store.put_many(data)
    assert [store.read(blob.iri) for blob in blobs] == data
    assert all(store.is_sound(digest) for digest in store.digests())
    assert len(list(store.digests())) == 40
    assert not list((tmp_path / "tmp").iterdir())


def test_what_comes_with_the_product_is_stored_when_it_is_asked_for(datasets, tmp_path):
    calls = []

    def toy() -> dict[str, bytes]:
        calls.append(1)
        return {"model": b"v1"}

    datasets.offer("robots/Toy", toy)
    assert datasets.names() == ["robots/Toy"]
    assert not calls
    assert datasets.find("robots/Toy").number == 1
    later = Datasets(tmp_path / "datasets")
    later.offer("robots/Toy", lambda: {"model": b"v2"})
    assert later.find("robots/Toy").number == 2
    assert later.read("robots/Toy@1", "model") == b"v1"


def test_a_namespace_may_begin_like_a_reserved_folder(datasets):
    datasets.create("viewsOfMine/Cups")
    assert datasets.find("viewsOfMine/Cups").name == "viewsOfMine/Cups@head"
    with pytest.raises(UsageError, match="expected <namespace>/<name>"):
        datasets.create("views/Cups")


def test_a_file_called_dataset_json_is_a_file_like_any_other(datasets):
    made(datasets, "lab/A", {"dataset.json": b"[]"})
    datasets.view(datasets.find("lab/A"))
    assert datasets.names(BOB) == ["lab/A"]


def test_what_a_stranger_sends_is_not_kept(datasets, tmp_path):
    datasets.create("lab/Secret", ALICE, readers=[])
    with pytest.raises(UnknownTermError):
        datasets.put("lab/Secret", {"x": b"of a stranger"}, BOB)
    assert not list(BlobStore(tmp_path / "datasets" / "blobs").digests())


@pytest.mark.parametrize("number", ["9" * 5000, "01", "x"])
def test_a_version_that_is_none_is_not_found(datasets, number):
    made(datasets, "lab/A", {"x": b"1"})
    with pytest.raises(UnknownTermError, match="there are 1, and head"):
        datasets.find(f"lab/A@{number}")


def test_contents_that_could_not_be_made_are_asked_for_again(datasets):
    answers = iter([OSError("not now"), {"model": b"v1"}])

    def toy() -> dict[str, bytes]:
        answer = next(answers)
        if isinstance(answer, OSError):
            raise answer
        return answer

    datasets.offer("robots/Toy", toy)
    with pytest.raises(OSError, match="not now"):
        datasets.find("robots/Toy")
    assert datasets.find("robots/Toy").number == 1
