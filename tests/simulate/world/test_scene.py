"""Tables laid with products."""

from __future__ import annotations

import numpy as np
import pytest

from simulate.grasping.table_reach import TableReach, arrange_for
from simulate.robots import describe
from simulate.world.objects import sample_objects, sample_products
from simulate.world.scene import Placement, _outline, arrange, arrange_in_reach


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


def _is_near(placement: Placement) -> bool:
    """Reach of an arm that closes across few directions, and not far away."""
    return placement.x < 0.17 and abs(np.sin(placement.yaw)) > 0.7


@pytest.mark.slow
def test_products_stand_in_reach_with_room_for_a_hand() -> None:
    for seed in range(6):
        specs = sample_products("light", np.random.default_rng(seed), 4)
        placed = arrange_in_reach(specs, np.random.default_rng(seed), _is_near)
        assert sorted(p.spec.name for p in placed) == sorted(s.name for s in specs)
        assert sum(_is_near(p) for p in placed) >= 3
        outlines = [_outline(p.spec, p.x, p.y, p.yaw) for p in placed]
        for i, a in enumerate(outlines):
            for b in outlines[:i]:
                assert np.linalg.norm(a[:, None] - b[None], axis=-1).min() >= 0.020
        assert sum(np.sign(p.y) for p in placed) == 0


@pytest.mark.slow
def test_a_table_without_any_place_in_reach_is_laid_all_the_same() -> None:
    specs = sample_products("light", np.random.default_rng(0), 6)
    placed = arrange_in_reach(specs, np.random.default_rng(0), lambda placement: False)
    assert sorted(p.spec.name for p in placed) == sorted(s.name for s in specs)


@pytest.mark.slow
def test_a_nao_reaches_both_ends_of_most_products_of_its_table_and_few_of_any_other() -> None:
    nao = describe("nao")
    reach = TableReach(nao)
    specs = sample_products("light", np.random.default_rng(1), 3)
    anywhere = arrange(specs, np.random.default_rng(1), workplace=nao.workplace)
    for_it = arrange_for(nao, specs, np.random.default_rng(1))
    assert sum(map(reach, for_it)) == 3 > sum(map(reach, anywhere))


def test_an_arm_that_closes_in_any_direction_gets_the_table_of_its_workplace() -> None:
    panda = describe("panda")
    specs = sample_products("hard", np.random.default_rng(1), 4)
    placed = arrange_for(panda, specs, np.random.default_rng(1))
    assert placed == arrange(specs, np.random.default_rng(1), workplace=panda.workplace)
