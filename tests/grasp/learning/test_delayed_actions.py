"""Actions that are carried out late, and learners that are told of them."""

from __future__ import annotations

import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

from grasp.learning.environments import DelayedActions, TwoRooms

WEST = 3


def test_without_delay_the_world_is_as_it_was() -> None:
    late, own = DelayedActions(TwoRooms(), 0), TwoRooms()
    state, _ = late.reset(seed=4)
    before, _ = own.reset(seed=4)
    assert np.array_equal(state, before)
    for action in (3, 1, 3, 0, 2):
        (state, *rest), (before, *others) = late.step(action), own.step(action)
        assert np.array_equal(state, before)
        assert rest == others


@pytest.mark.parametrize("tells", [True, False])
def test_an_action_moves_the_robot_so_many_steps_later(tells: bool) -> None:
    late = DelayedActions(TwoRooms(stochastic=False), 2, tells)
    start, _ = late.reset(seed=1)
    columns = [int(late.step(WEST)[0][1]) - int(start[1]) for _ in range(4)]
    assert columns == [0, 0, -1, -2]
    late.reset(seed=1)
    state = late.step(WEST)[0]
    assert state[2:].tolist() == ([0, WEST] if tells else [])


def test_every_state_that_is_told_has_a_cell_of_its_own() -> None:
    late = DelayedActions(TwoRooms(), 2)
    bins = late.bins(TwoRooms.bins())
    assert bins.count == TwoRooms.bins().count * 16
    numbers = {
        bins.number(np.array([1, 2, first, second])) for first in range(4) for second in range(4)
    }
    assert len(numbers) == 16


@pytest.mark.filterwarnings("ignore:.*different from the unwrapped version")
def test_gymnasium_takes_it_for_an_environment() -> None:
    check_env(DelayedActions(TwoRooms(), 1), skip_render_check=True)


def test_a_negative_delay_is_refused() -> None:
    with pytest.raises(ValueError, match="0 steps or more"):
        DelayedActions(TwoRooms(), -1)
