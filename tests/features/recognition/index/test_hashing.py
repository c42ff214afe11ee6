"""Binary codes: the same on every machine, near for near descriptors."""

from __future__ import annotations

import numpy as np
import pytest

from features.recognition.index.hashing import TABLE_BITS, TABLES, Hasher, used_table_bits


def descriptors(count: int, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).integers(0, 120, (count, 128)).astype(np.uint8)


CODES = ["0x2020a43379dfa662", "0xa828baad5970d150", "0x22d84588656ed0c6", "0x87de80e385047a7c"]
BUCKETS = [403590, 414368, 566911, 900098, 79920, 603214, 275574, 97278]
DIGEST = "98292be7685133b177b8802011049f8219f3f18796fac53bdce497cafda68e77"


def test_codes_are_the_stored_ones_on_every_platform() -> None:
    ramp = (np.arange(256).reshape(2, 128) % 97).astype(np.uint8)
    codes, buckets = Hasher.seeded().encode(ramp)
    assert [hex(word) for word in codes.ravel().tolist()] == CODES
    assert buckets[0].tolist() == BUCKETS
    assert Hasher.seeded().digest() == DIGEST


def test_a_descriptor_has_the_same_code_alone_and_among_others() -> None:
    hasher, many = Hasher.seeded(), descriptors(300)
    codes, buckets = hasher.encode(many)
    for k in (0, 7, 299):
        code, bucket = hasher.encode(many[k : k + 1])
        assert np.array_equal(code[0], codes[k])
        assert np.array_equal(bucket[0], buckets[k])


def test_every_partial_sum_of_a_projection_fits_into_float32_exactly() -> None:
    hasher = Hasher.seeded()
    largest = 255 * np.abs(hasher.code_projections.astype(np.int64)).sum(axis=1).max()
    assert largest < 2**24


def test_near_descriptors_have_near_codes() -> None:
    base = descriptors(200).astype(int)
    near = np.clip(base + np.random.default_rng(1).integers(-8, 9, base.shape), 0, 255)
    hasher = Hasher.seeded()
    a, b = hasher.encode(base.astype(np.uint8))[0], hasher.encode(near.astype(np.uint8))[0]
    distance = np.bitwise_count(a ^ b).sum(axis=1)
    stranger = np.bitwise_count(a ^ np.roll(b, 1, axis=0)).sum(axis=1)
    # The angle of noise of 5 against a spread of 35 turns about one sign in twenty.
    assert distance.mean() < 12
    assert stranger.mean() > 40


def test_bucket_numbers_keep_all_bits() -> None:
    _, buckets = Hasher.seeded().encode(descriptors(2000))
    assert buckets.shape == (2000, TABLES)
    assert buckets.max() < 2**TABLE_BITS
    assert buckets.max() >= 2 ** (TABLE_BITS - 1)


def test_few_descriptors_use_few_bits() -> None:
    assert used_table_bits(500) == 8
    assert used_table_bits(60_000) == 13
    assert used_table_bits(10**9) == 18


def test_wrong_shape_is_named() -> None:
    with pytest.raises(ValueError, match=r"\(n, 128\).*\(3, 64\)"):
        Hasher.seeded().encode(np.zeros((3, 64), np.uint8))
