"""Tables laid with products."""

from __future__ import annotations

import numpy as np
import pytest

from simulate.world.objects import sample_objects
from simulate.world.scene import _outline, arrange


@pytest.mark.slow
@pytest.mark.parametrize("number", [1, 6, pytest.param(12, marks=pytest.mark.deep)])
def test_every_table_finds_room_and_leaves_some_for_a_hand(number: int) -> None:
    for seed in range(8):
        specs = sample_objects(np.random.default_rng(seed), number)
        placed = arrange(specs, np.random.default_rng(seed))
        assert sorted(p.spec.name for p in placed) == sorted(s.name for s in specs)
        outlines = [_outline(p.spec, p.x, p.y, p.yaw) for p in placed]
        for i, a in enumerate(outlines):
            assert np.abs(a[:, 1]).max() < 0.21, "inside the box"
            for b in outlines[:i]:
                assert np.linalg.norm(a[:, None] - b[None], axis=-1).min() >= 0.022
        assert abs(sum(np.sign(p.y) for p in placed)) <= 1


@pytest.mark.slow
def test_six_objects_lie_where_arms_reach() -> None:
    for seed in range(30):
        specs = sample_objects(np.random.default_rng(seed), 6)
        assert max(p.x for p in arrange(specs, np.random.default_rng(seed))) < 0.24


def test_the_same_seed_lays_the_same_table() -> None:
    specs = sample_objects(np.random.default_rng(0), 6)
    assert arrange(specs, np.random.default_rng(1)) == arrange(specs, np.random.default_rng(1))
    assert arrange(specs, np.random.default_rng(1)) != arrange(specs, np.random.default_rng(2))


@pytest.mark.slow
def test_too_many_objects_are_refused() -> None:
    specs = sample_objects(np.random.default_rng(0), 60)
    with pytest.raises(ValueError, match="no room for 60 objects"):
        arrange(specs, np.random.default_rng(0))
