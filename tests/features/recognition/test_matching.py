"""The matching kernels against the exhaustive truth."""

from __future__ import annotations

import numpy as np
import pytest

from features.recognition import RecognitionIndex
from features.recognition.comparison.votes import nearest_views
from features.recognition.index import cascade
from features.recognition.index.cascade import (
    build_tables,
    match_exact,
    match_flat,
    match_tables,
)
from features.recognition.index.hashing import Hasher, used_table_bits
from features.recognition.index.nearest import (
    FAR,
    inner_products,
    nearest_both_ways,
    nearest_rows,
    squared_distances,
)
from features.recognition.index.snapshot import EXACT_BELOW
from tests.features.recognition.exhaustive import ExactMatcher


@pytest.fixture(scope="module")
def stored(card_views):
    """Return real descriptors of twelve cards, one view each, with codes."""
    views = [card_views(card, 1)[0] for card in range(12)]
    descriptors = np.concatenate([v.descriptors for v in views])
    view = np.repeat(np.arange(12), [len(v) for v in views]).astype(np.int32)
    codes, buckets = Hasher.seeded().encode(descriptors)
    assert len(descriptors) > 3000
    return descriptors, view, codes, buckets


def noisy(descriptors: np.ndarray, sigma: float = 6.0) -> np.ndarray:
    rng = np.random.default_rng(3)
    moved = descriptors + rng.normal(0, sigma, descriptors.shape)
    return np.clip(np.rint(moved), 0, 255).astype(np.uint8)


def by_tables(query, stored, alive=None, bits=9, labels=None):
    descriptors, view, codes, buckets = stored
    hasher = Hasher.seeded()
    query_codes, query_buckets = hasher.encode(query)
    offsets, rows = build_tables(buckets, bits)
    labels = np.arange(view.max() + 1, dtype=np.int32) if labels is None else labels
    alive = np.ones(len(descriptors), np.uint8) if alive is None else alive
    return match_tables(
        *(query, query_codes, query_buckets, descriptors, codes, offsets, rows),
        *(labels, view, alive, bool(alive.all())),
    )


def test_a_first_descriptor_in_empty_buckets_writes_nowhere(stored, monkeypatch):
    """Compiled code checks no bounds: the same lines are run as Python, which does."""
    descriptors, view, codes, buckets = stored
    monkeypatch.setattr(cascade, "_distinct_rows", cascade._distinct_rows.py_func)
    offsets, rows = build_tables(np.zeros_like(buckets), 8)  # all in bucket 0 of each table
    elsewhere = np.ones((1, buckets.shape[1]), np.uint32)
    best, nearest, _, rival = match_tables.py_func(
        *(descriptors[:1], codes[:1], elsewhere, descriptors, codes, offsets, rows),
        *(np.arange(12, dtype=np.int32), view, np.ones(len(view), np.uint8), True),
    )
    assert (best.tolist(), nearest.tolist(), rival.tolist()) == ([-1], [FAR], [FAR])


def by_codes(query, stored, alive=None):
    descriptors, view, codes, _ = stored
    query_codes, _ = Hasher.seeded().encode(query)
    labels = np.arange(view.max() + 1, dtype=np.int32)
    alive = np.ones(len(descriptors), np.uint8) if alive is None else alive
    return match_flat(query, query_codes, descriptors, codes, labels, view, alive)


def test_the_full_product_is_the_exhaustive_search(stored) -> None:
    descriptors, view, _, _ = stored
    query = noisy(descriptors[::7])
    _, nearest, _, rival = match_exact(query, descriptors, view)
    best, true_nearest, true_rival = ExactMatcher(descriptors, view).match(query)
    assert np.array_equal(nearest, true_nearest)
    assert np.array_equal(rival, true_rival)
    assert (view[best] >= 0).all()


@pytest.mark.parametrize(("matcher", "least"), [(by_codes, 0.99), (by_tables, 0.97)])
def test_hashing_finds_what_the_exhaustive_search_finds(stored, matcher, least) -> None:
    descriptors, view, _, _ = stored
    query = noisy(descriptors[::5])
    truth, _, true_rival = ExactMatcher(descriptors, view).match(query)
    best, nearest, _, rival = matcher(query, stored)
    assert (best == truth).mean() > least
    assert (nearest[best == truth] < FAR).all()
    # A rival that was missed can only seem farther than it is.
    assert (rival[best == truth] >= true_rival[best == truth]).all()


def test_removed_rows_are_never_found(stored) -> None:
    descriptors, view, _, _ = stored
    alive = (view != 4).astype(np.uint8)
    query = noisy(descriptors[view == 4])
    for matcher in (by_codes, by_tables):
        best, _, _, _ = matcher(query, stored, alive=alive)
        assert not (view[best[best >= 0]] == 4).any()


def test_one_bucket_for_all_rows_gives_the_answer_of_all_codes(stored) -> None:
    """Every row then stands once in each of eight tables, and counts once."""
    descriptors, view, _, _ = stored
    query, alive = noisy(descriptors[::9]), (view % 3 > 0).astype(np.uint8)
    by_one_bucket = by_tables(query, stored, alive=alive, bits=0)
    for found, expected in zip(by_one_bucket, by_codes(query, stored, alive), strict=True):
        assert np.array_equal(found, expected)


def test_other_views_of_the_same_object_are_no_rivals(stored) -> None:
    descriptors, view, _, _ = stored
    query = noisy(descriptors[view == 0])
    alone = by_tables(query, stored)
    same = np.arange(12, dtype=np.int32)
    same[1:] = 0
    together = by_tables(query, stored, labels=same)
    assert np.array_equal(alone[0], together[0])
    assert (together[3] == FAR).all()


def test_too_many_table_bits_leave_matches_without_a_rival(stored) -> None:
    """A missing rival passes the ratio rule: why the bits follow the number of rows."""
    descriptors, view, codes, buckets = stored
    few = tuple(a[view < 2] for a in (descriptors, view, codes, buckets))
    query = noisy(few[0])

    def without_rival(bits: int) -> float:
        best, _, _, rival = by_tables(query, few, bits=bits)
        return float((rival[best >= 0] == FAR).mean())

    assert without_rival(used_table_bits(len(few[0]))) < 0.05
    assert without_rival(18) > 0.3


def test_an_object_of_many_views_still_meets_its_rivals(stored) -> None:
    """Fourteen near-identical views fill the ten nearest places alone."""
    descriptors, view, _, _ = stored
    copies = [noisy(descriptors[view == 0], sigma=2.0) for _ in range(14)]
    crowd = np.concatenate([*copies, descriptors[view == 1]])
    crowd_view = np.repeat(np.arange(15), [*[len(c) for c in copies], (view == 1).sum()])
    codes, buckets = Hasher.seeded().encode(crowd)
    labels = np.array([0] * 14 + [1], np.int32)
    query, packed = copies[0], (crowd, crowd_view.astype(np.int32), codes, buckets)
    _, _, truth = ExactMatcher(crowd, labels[crowd_view]).match(query)
    for best, _, _, rival in (
        by_tables(query, packed, labels=labels),
        match_flat(
            *(query, Hasher.seeded().encode(query)[0], crowd, codes, labels),
            *(packed[1], np.ones(len(crowd), np.uint8)),
        ),
    ):
        assert (labels[crowd_view[best]] == 0).all()
        assert (rival < FAR).mean() > 0.95
        # Five of 300 are measured: about the nearest one, never nearer than it.
        assert (rival >= truth).all()
        assert np.median(rival) < 1.25 * np.median(truth)


@pytest.mark.slow
def test_the_index_finds_the_best_over_all_its_parts(card_views) -> None:
    """Sealed with tables, growing by codes, or growing by the full product: the same answer."""
    views = [card_views(card, 1)[0] for card in range(12)]
    query = noisy(views[5].descriptors)
    answers = []
    for seal_rows in (10**9, 700, 1):
        with RecognitionIndex(seal_rows=seal_rows) as index:
            for k, view in enumerate(views):
                index.add(f"view:{k}", f"object:{k}", "class:card", view)
            answers.append(index.snapshot().match(query))
    sizes = [len(view) for view in views]
    assert sum(sizes) > EXACT_BELOW
    for answer in answers:
        assert (answer.view == 5).mean() > 0.97
        same = (answer.view == 5) & (answers[0].view == 5)
        assert np.array_equal(answer.nearest[same], answers[0].nearest[same])


def test_the_rival_comes_from_another_object_in_any_part(card_views) -> None:
    """The same object stored in two segments must not stand in its own way."""
    first, second = card_views(0, 2)
    with RecognitionIndex(seal_rows=1) as index:
        index.add("view:a", "object:0", "class:card", first)
        index.add("view:b", "object:0", "class:card", second)
        index.add("view:c", "object:1", "class:card", card_views(1, 1)[0])
        whole = index.snapshot().match(first.descriptors)
    truth = match_exact(
        first.descriptors,
        np.concatenate([first.descriptors, second.descriptors, card_views(1, 1)[0].descriptors]),
        np.repeat([0, 0, 1], [len(first), len(second), len(card_views(1, 1)[0])]).astype(np.int32),
    )
    assert (whole.nearest == 0).all()
    assert (whole.rival >= truth[3]).all()
    assert np.median(whole.rival[whole.rival < FAR]) == pytest.approx(np.median(truth[3]), rel=0.2)


def test_rivals_can_be_asked_by_class(card_views) -> None:
    with RecognitionIndex() as index:
        for card in range(3):
            index.add(f"view:{card}", f"object:{card}", "class:card", card_views(card, 1)[0])
        snapshot = index.snapshot()
    query = card_views(0, 1)[0].descriptors
    by_object, by_class = snapshot.match(query), snapshot.match(query, snapshot.class_of_view)
    assert (by_class.rival == FAR).all()
    assert (by_class.rival_view == -1).all()
    assert set(by_object.rival_view.tolist()) == {1, 2}


def test_nothing_stored_and_nothing_asked() -> None:
    snapshot = RecognitionIndex().snapshot()
    assert len(snapshot.match(np.empty((0, 128), np.uint8)).view) == 0
    matches = snapshot.match(np.zeros((2, 128), np.uint8))
    assert matches.view.tolist() == [-1, -1]
    assert matches.nearest.tolist() == [FAR, FAR]


@pytest.mark.parametrize("seed", range(4))
def test_nearest_views_one_by_one_are_those_of_all_at_once(seed: int) -> None:
    """Few different values, so that many distances are equal."""
    rng = np.random.default_rng(seed)
    query = rng.integers(0, 2, (40, 128)).astype(np.uint8)
    sizes = rng.integers(0, 4, 7)
    blocks = [query[rng.integers(0, 40, size)] ^ (rng.random((size, 128)) < 0.02) for size in sizes]
    labels = rng.integers(0, 3, len(blocks)).astype(np.int32)
    view = np.repeat(np.arange(len(blocks)), sizes)
    best, nearest, rival_row, rival = match_exact(query, np.concatenate(blocks), labels[view])
    found = nearest_views(query, blocks, labels)
    expected = np.where(best < 0, -1, view[best]), nearest, None, rival
    for one, other in zip(found, expected, strict=True):
        assert other is None or np.array_equal(one, other)
    assert np.array_equal(found[2], np.where(rival_row < 0, -1, view[rival_row]))


@pytest.mark.parametrize("seed", range(3))
def test_nearest_both_ways_are_those_of_all_distances(seed: int) -> None:
    """Few different values, so that many distances are equal: the first of them counts."""
    rng = np.random.default_rng(seed)
    query, stored = (rng.integers(0, 2, (n, 128)).astype(np.uint8) * 200 for n in (30, 41))
    stored[5:9], stored[20] = query[3], query[7] ^ 1
    distances = squared_distances(query, stored)
    differences = query[:, None].astype(int) - stored
    assert np.array_equal(distances, (differences**2).sum(axis=2))
    best, best_back, nearest, second = nearest_both_ways(query, stored)
    assert [rows.tolist() for rows in nearest_rows(query, stored)] == [
        distances.argmin(axis=1).tolist(),
        distances.min(axis=1).tolist(),
    ]
    assert np.array_equal(best, distances.argmin(axis=1))
    assert np.array_equal(best_back, distances.argmin(axis=0))
    assert np.array_equal(np.stack([nearest, second], axis=1), np.sort(distances, axis=1)[:, :2])
    assert (nearest[3], second[3]) == (0, 0)


def test_inner_products_hold_the_largest_and_least_numbers() -> None:
    rows = np.array([[255] * 128, [-255] * 128, [1, -1] * 64], np.int16)
    others = np.array([[511] * 128, [-511] * 128, [*range(-64, 64)]], np.int16)
    expected = rows.astype(np.int64) @ others.T.astype(np.int64)
    assert np.array_equal(inner_products(rows, others), expected)
    assert np.array_equal(inner_products(rows[::2], np.asfortranarray(others)), expected[::2])
    assert inner_products(rows[:0], others).shape == (0, 3)


def test_a_view_removed_from_hash_tables_is_no_longer_matched(card_views) -> None:
    """The part that lost it reads which rows are removed, which whole parts need not."""
    views = [card_views(card, 1)[0] for card in range(12)]
    with RecognitionIndex(seal_rows=10**9) as index:
        for k, view in enumerate(views):
            index.add(f"view:{k}", f"object:{k}", "class:card", view)
        index.save()
        (part,) = index.snapshot().parts
        assert part.block.tables is not None
        assert len(part.block) > EXACT_BELOW
        assert (index.snapshot().match(views[5].descriptors).view == 5).mean() > 0.9
        index.remove("view:5")
        assert not (index.snapshot().match(views[5].descriptors).view == 5).any()
