"""Two images matched by hashing, against the kernel of the index and against the full product."""

from __future__ import annotations

import numpy as np
import pytest

from features.recognition.index.cascade import match_tables
from features.recognition.index.hashing import Hasher
from features.recognition.index.image_pair import HashedImage, match_images
from features.recognition.index.nearest import squared_distances

CAP, RATIO = 128_450, 0.64


@pytest.fixture(scope="module")
def images(card_views) -> tuple[HashedImage, HashedImage]:
    """Return two images of one card and halves of two others, disturbed."""
    rng = np.random.default_rng(5)
    shared, left, right = (card_views(card, 1)[0].descriptors for card in range(3))
    disturbed = np.clip(np.rint(shared + rng.normal(0, 6, shared.shape)), 0, 255).astype(np.uint8)
    hasher = Hasher.seeded()
    return (
        HashedImage.of(np.concatenate([shared, left[::2]]), hasher),
        HashedImage.of(np.concatenate([right[::2], rng.permutation(disturbed)]), hasher),
    )


def by_index(one: HashedImage, other: HashedImage) -> tuple[np.ndarray, np.ndarray]:
    """Return the matches by the kernel of the index, every row an object of its own."""

    def nearest(query: HashedImage, stored: HashedImage) -> tuple[np.ndarray, ...]:
        own = np.arange(len(stored.descriptors), dtype=np.int32)
        best, distance, _, rival = match_tables(
            *(query.descriptors, query.codes, query.buckets),
            *(stored.descriptors, stored.codes, stored.offsets, stored.rows),
            *(own, own, np.ones(len(own), np.uint8), True),
        )
        return best, distance, rival

    best, distance, rival = nearest(one, other)
    accepted = (distance < CAP) & (distance < RATIO * np.minimum(rival, 2**30))
    back = nearest(other, one)[0]
    rows = np.flatnonzero(accepted)
    rows = rows[back[best[rows]] == rows]
    return rows, best[rows]


def test_it_matches_what_the_kernel_of_the_index_matches_both_ways(images) -> None:
    rows, columns = match_images(*images, CAP, RATIO)
    expected_rows, expected_columns = by_index(*images)
    assert len(rows) > 200
    assert np.array_equal(rows, expected_rows)
    assert np.array_equal(columns, expected_columns)


def test_nearly_all_matches_are_those_of_the_full_product(images) -> None:
    one, other = images
    distances = squared_distances(one.descriptors, other.descriptors)
    best = distances.argmin(axis=1)
    mutual = distances.argmin(axis=0)[best] == np.arange(len(best))
    two = np.sort(distances, axis=1)[:, :2]
    exact = set(np.flatnonzero(mutual & (two[:, 0] < CAP) & (two[:, 0] < RATIO * two[:, 1])))
    rows = set(match_images(one, other, CAP, RATIO)[0])
    # Hashing misses some second neighbours, so that it accepts some more.
    assert len(rows & exact) >= 0.97 * len(exact)
    assert len(rows & exact) >= 0.9 * len(rows)


def test_an_image_without_descriptors_matches_nothing() -> None:
    hasher = Hasher.seeded()
    empty = HashedImage.of(np.empty((0, 128), np.uint8), hasher)
    some = HashedImage.of(np.eye(128, dtype=np.uint8) * 90, hasher)
    for pair in ((empty, some), (some, empty), (empty, empty)):
        rows, columns = match_images(*pair, CAP, RATIO)
        assert len(rows) == len(columns) == 0
