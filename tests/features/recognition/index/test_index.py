"""The growing index: what is added is found, what is removed is gone, files survive."""

from __future__ import annotations

import tracemalloc
from pathlib import Path

import numpy as np
import pytest

from features.recognition import (
    IndexCorruptError,
    IndexLockedError,
    Recogniser,
    RecognitionIndex,
    ViewName,
)
from features.recognition.index.segments import Block


def fill(index: RecognitionIndex, card_views, cards: int, views: int = 1) -> None:
    for card in range(cards):
        for k, features in enumerate(card_views(card, views)):
            index.add(f"view:{card}.{k}", f"object:{card}", "class:card", features)


def found(index: RecognitionIndex, features) -> str:
    """Return the object that most descriptors vote for."""
    snapshot = index.snapshot()
    views = snapshot.match(features.descriptors).view
    best = np.bincount(views[views >= 0], minlength=1).argmax()
    return snapshot.object_iris[snapshot.object_of_view[best]]


def test_an_added_view_is_found_by_the_next_query(card_views) -> None:
    index = RecognitionIndex()
    fill(index, card_views, 3)
    assert len(index) == 3
    assert "view:2.0" in index
    assert found(index, card_views(2, 1)[0]) == "object:2"


def test_views_come_back_in_the_order_of_adding(card_views) -> None:
    index = RecognitionIndex()
    fill(index, card_views, 3)
    assert list(index.views())[1] == ViewName("view:1.0", "object:1", "class:card")


@pytest.mark.slow
@pytest.mark.parametrize("seal_rows", [10**9, 1000, 1])
def test_everything_is_there_after_reopening(tmp_path: Path, card_views, seal_rows) -> None:
    with RecognitionIndex(tmp_path / "index", seal_rows=seal_rows) as index:
        fill(index, card_views, 6, views=2)
        index.remove("view:3.0")
        index.relabel("view:1.1", "object:other", "class:new")
        index.add("view:0.0", "object:0", "class:card", card_views(5, 1)[0])
        names, query = list(index.views()), card_views(4, 1)[0].descriptors
        before = index.snapshot().match(query)
    with RecognitionIndex(tmp_path / "index") as index:
        assert list(index.views()) == names
        after = index.snapshot().match(query)
        assert np.array_equal(before.nearest, after.nearest)
        assert "view:3.0" not in index
        assert ViewName("view:1.1", "object:other", "class:new") in names


def test_sealing_changes_nothing_that_is_seen(tmp_path: Path, card_views) -> None:
    with RecognitionIndex(tmp_path / "index") as index:
        fill(index, card_views, 5)
        index.remove("view:2.0")
        index.relabel("view:3.0", "object:three")
        names = sorted(index.views())
        index.save()
        index.save()
        assert sorted(index.views()) == names
        assert found(index, card_views(3, 1)[0]) == "object:three"
    with RecognitionIndex(tmp_path / "index") as index:
        assert sorted(index.views()) == names


def test_changes_of_sealed_views_survive_the_next_seal(tmp_path: Path, card_views) -> None:
    with RecognitionIndex(tmp_path / "index") as index:
        fill(index, card_views, 6)
        index.save()
        index.remove("view:0.0")
        index.relabel("view:1.0", "object:one")
        index.add("view:late", "object:6", "class:card", card_views(6, 1)[0])
        index.save()
        names = list(index.views())
    with RecognitionIndex(tmp_path / "index") as index:
        assert list(index.views()) == names
        assert "view:0.0" not in index
        assert found(index, card_views(1, 1)[0]) == "object:one"
        assert found(index, card_views(6, 1)[0]) == "object:6"


def test_a_view_of_the_same_iri_is_replaced(card_views) -> None:
    index = RecognitionIndex()
    index.add("view:a", "object:0", "class:card", card_views(0, 1)[0])
    index.add("view:a", "object:1", "class:card", card_views(1, 1)[0])
    assert [name.object_iri for name in index.views()] == ["object:1"]
    assert found(index, card_views(1, 1)[0]) == "object:1"


def test_the_same_view_under_two_iris_is_stored_twice(card_views) -> None:
    index = RecognitionIndex()
    for iri in ("view:a", "view:b"):
        index.add(iri, "object:0", "class:card", card_views(0, 1)[0])
    assert len(index) == 2
    matches = index.snapshot().match(card_views(0, 1)[0].descriptors)
    assert (matches.rival > 1_000_000).all()


def test_removing_all_leaves_an_index_that_answers(tmp_path: Path, card_views) -> None:
    with RecognitionIndex(tmp_path / "index") as index:
        fill(index, card_views, 2)
        index.save()
        assert index.remove("view:0.0")
        assert index.remove("view:1.0")
        assert not index.remove("view:1.0")
        assert Recogniser(index).recognise(card_views(0, 1)[0]).outcome == "null"
    with RecognitionIndex(tmp_path / "index") as index:
        assert len(index) == 0


def test_relabelling_an_unknown_view_is_an_error(card_views) -> None:
    with pytest.raises(KeyError, match="view:none"):
        RecognitionIndex().relabel("view:none", "object:0")


@pytest.mark.slow
def test_segments_of_like_size_are_merged(tmp_path: Path, card_views) -> None:
    with RecognitionIndex(tmp_path / "index", seal_rows=1) as index:
        fill(index, card_views, 12)
        parts = index.snapshot().parts
        # Twelve seals of about one size: 8 + 4, with room for one more.
        assert len(parts) <= 4
        assert sum(len(part.block.looks) for part in parts) == 12
    assert len(list((tmp_path / "index").glob("seg-*"))) == len(parts)


def test_a_quarter_of_dead_views_compacts_a_segment(tmp_path: Path, card_views) -> None:
    with RecognitionIndex(tmp_path / "index") as index:
        fill(index, card_views, 8)
        index.save()
        rows = len(index.snapshot().parts[0].block)
        for card in range(3):
            index.remove(f"view:{card}.0")
        assert len(index.snapshot().parts[0].block) < 0.8 * rows
        assert len(index) == 5


def test_views_without_keypoints_are_stored_too(tmp_path: Path, photo) -> None:
    from features.recognition import describe_view

    flat = describe_view(np.full((60, 60), 90, np.uint8), np.ones((60, 60), bool))
    assert len(flat) == 0
    with RecognitionIndex(tmp_path / "index") as index:
        index.add("view:flat", "object:flat", "class:card", flat)
        index.save()
    with RecognitionIndex(tmp_path / "index") as index:
        assert "view:flat" in index
        index.snapshot().match(flat.descriptors)


def test_one_folder_has_one_writer(tmp_path: Path) -> None:
    first = RecognitionIndex(tmp_path / "index")
    with pytest.raises(IndexLockedError, match="one writer"):
        RecognitionIndex(tmp_path / "index")
    first.close()
    RecognitionIndex(tmp_path / "index").close()


def test_a_reader_sees_what_the_writer_added(tmp_path: Path, card_views) -> None:
    with RecognitionIndex(tmp_path / "index") as writer:
        fill(writer, card_views, 2)
        with RecognitionIndex(tmp_path / "index", mode="r") as reader:
            assert len(reader) == 2
            assert not reader.refresh()
            writer.add("view:new", "object:3", "class:card", card_views(3, 1)[0])
            assert len(reader) == 2
            assert reader.refresh()
            assert found(reader, card_views(3, 1)[0]) == "object:3"
            writer.save()
            assert reader.refresh()
            assert len(reader) == 3
            with pytest.raises(ValueError, match="reading only"):
                reader.remove("view:new")


def test_a_closed_index_takes_no_more(card_views, tmp_path: Path) -> None:
    index = RecognitionIndex(tmp_path / "index")
    index.close()
    index.close()
    with pytest.raises(ValueError, match="closed"):
        index.add("view:a", "object:0", "class:card", card_views(0, 1)[0])


def test_features_of_another_extractor_are_refused(card_views) -> None:
    from dataclasses import replace

    foreign = replace(card_views(0, 1)[0], extractor="surf/9")
    with pytest.raises(ValueError, match="surf/9"):
        RecognitionIndex().add("view:a", "object:0", "class:card", foreign)


@pytest.mark.slow
@pytest.mark.parametrize(
    "victim", ["manifest.json", "header.npz", "seg-*/desc.u8", "seg-*/meta.json", "seg-*/ids.i32"]
)
def test_damage_is_named_and_repaired_by_rebuilding(tmp_path: Path, card_views, victim) -> None:
    with RecognitionIndex(tmp_path / "index") as index:
        fill(index, card_views, 3)
        index.save()
    path = min((tmp_path / "index").glob(victim))
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 0xFF
    data[len(data) // 2 + 1] ^= 0xFF
    path.write_bytes(bytes(data))
    with pytest.raises(IndexCorruptError, match="rtask rebuild") as caught:
        RecognitionIndex(tmp_path / "index")
    assert path.name in str(caught.value) or "manifest" in str(caught.value)

    views = [
        (f"view:{card}", f"object:{card}", "class:card", card_views(card, 1)[0].to_bytes())
        for card in range(3)
    ]
    with RecognitionIndex.rebuild(tmp_path / "index", views) as index:
        assert len(index) == 3
        assert found(index, card_views(1, 1)[0]) == "object:1"


def test_a_missing_segment_is_named(tmp_path: Path, card_views) -> None:
    with RecognitionIndex(tmp_path / "index") as index:
        fill(index, card_views, 2)
        index.save()
    min((tmp_path / "index").glob("seg-*/kp.f32")).unlink()
    with pytest.raises(IndexCorruptError, match=r"kp\.f32"):
        RecognitionIndex(tmp_path / "index")


def test_rebuilding_gives_the_same_answers(tmp_path: Path, card_views) -> None:
    with RecognitionIndex(tmp_path / "index") as index:
        fill(index, card_views, 4)
        query = card_views(2, 2)[1]
        before = Recogniser(index).recognise(query)
    views = [
        (f"view:{card}.0", f"object:{card}", "class:card", card_views(card, 1)[0].to_bytes())
        for card in range(4)
    ]
    with RecognitionIndex.rebuild(tmp_path / "index", views) as index:
        after = Recogniser(index).recognise(query)
    assert after.outcome == before.outcome
    assert after.matches[0].inliers == pytest.approx(before.matches[0].inliers, rel=0.1)


def test_rows_of_a_view_are_found_without_a_copy_of_all() -> None:
    """A million rows of 4 bytes; a copy of the column would take twice as many."""
    block = Block.empty(rows=1_000_000, views=3)
    block.view_of_row[400_000:] = 2
    tracemalloc.start()
    try:
        assert block.rows_of(2) == slice(400_000, 1_000_000)
        assert tracemalloc.get_traced_memory()[1] < 100_000
    finally:
        tracemalloc.stop()
