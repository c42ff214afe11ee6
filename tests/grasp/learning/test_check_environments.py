"""The small worlds are those of the literature: their tables, their chances, their optimum."""

from __future__ import annotations

from collections import Counter

import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

from grasp.learning.environments import Bins, MountainCar, Taxi, TwoRooms
from grasp.learning.environments.compass import EAST, NORTH, SHARES, SIDES, SOUTH, WEST, aside
from grasp.learning.environments.taxi import IN_TAXI, LANDMARKS, PICK_UP, PUT_DOWN


@pytest.mark.parametrize("world", [TwoRooms, Taxi, MountainCar])
@pytest.mark.parametrize("stochastic", [False, True])
@pytest.mark.filterwarnings("ignore:.*not within.*:UserWarning")
def test_gymnasium_finds_no_fault(world: type, stochastic: bool) -> None:
    check_env(world(stochastic), skip_render_check=True)


def test_the_rooms_are_joined_by_one_door() -> None:
    rooms = [(row, column) for row in range(5) for column in range(11)]
    crossings = {
        (state, TwoRooms.moved(state, direction))
        for state in rooms
        for direction in (NORTH, SOUTH, EAST, WEST)
        if (state[1] < 5) != (TwoRooms.moved(state, direction)[1] < 5)
    }
    assert crossings == {((2, 4), (2, 5)), ((2, 5), (2, 4))}
    assert TwoRooms.moved((2, 5), NORTH) == (2, 5)
    assert TwoRooms.moved((2, 5), SOUTH) == (2, 5)
    assert TwoRooms.moved((0, 0), SOUTH) == (0, 0)
    assert TwoRooms.moved((3, 5), WEST) == (3, 5)


def _optimum(stochastic: bool) -> float:
    """Value iteration, undiscounted, averaged over where episodes start."""
    world = TwoRooms(stochastic)
    values = np.zeros((5, 11))
    for _ in range(500):
        new = values.copy()
        for row in range(5):
            for column in range(11):
                if (row, column) == (1, 1):
                    continue
                new[row, column] = max(
                    sum(
                        share * (0.0 if there == (1, 1) else values[there] - 1)
                        for share, there in world.outcomes((row, column), action)
                    )
                    for action in range(4)
                )
        values = new
    return float(values[:, 6:].mean())


@pytest.mark.slow
def test_the_best_policy_earns_what_is_published() -> None:
    assert _optimum(stochastic=False) == pytest.approx(-8.2, abs=1e-6)
    assert _optimum(stochastic=True) == pytest.approx(-11.38, abs=0.005)  # given to 2 places


def test_a_fifth_of_the_moves_go_sideways() -> None:
    world = TwoRooms()
    world.reset(seed=1)
    seen: Counter[tuple[int, int]] = Counter()
    for _ in range(20_000):
        world._state = (2, 8)
        seen[tuple(world.step(NORTH)[0].tolist())] += 1  # type: ignore[arg-type]
    # standard error of a share of .1 in 20,000 is .002
    assert seen[(3, 8)] / 20_000 == pytest.approx(0.8, abs=0.012)
    assert seen[(2, 9)] / 20_000 == pytest.approx(0.1, abs=0.009)
    assert seen[(2, 7)] / 20_000 == pytest.approx(0.1, abs=0.009)


def test_a_passenger_changes_the_destination_once_in_a_while() -> None:
    world = Taxi()
    world.reset(seed=2)
    changed = 0
    for _ in range(5_000):
        world._state = (*LANDMARKS[0], 0, 2)
        world.step(PICK_UP)
        while world._fresh:
            world.step(EAST)
        after = world._state[3]
        world.step(WEST)
        assert world._state[3] == after  # the mind changes on the first move only
        changed += after != 2
    assert changed / 5_000 == pytest.approx(0.3, abs=0.026)  # four standard errors


def test_the_taxi_earns_and_pays() -> None:
    world = Taxi(stochastic=False)
    world.reset(seed=0)
    world._state = (4, 0, 0, 1)
    assert world.step(PUT_DOWN)[1] == -10
    assert world.step(PICK_UP)[1] == -1
    assert world._state[2] == IN_TAXI
    assert world.step(PICK_UP)[1] == -10
    world._state = (0, 3, IN_TAXI, 1)
    _, reward, ended, _, _ = world.step(PUT_DOWN)
    assert (reward, ended) == (20, True)
    walls = [((0, 0), (0, 0)), ((2, 0), (2, 1)), ((3, 1), (3, 1)), ((0, 2), (0, 2))]
    assert [Taxi.moved(*place, EAST) for place, _ in walls] == [there for _, there in walls]


def test_the_car_moves_by_the_velocity_before_the_push() -> None:
    world = MountainCar(stochastic=False)
    world.reset(seed=0)
    world._state = np.array([-0.5, 0.02])
    state, reward, ended, _, _ = world.step(2)
    assert state == pytest.approx([-0.48, 0.02 + 0.001 - 0.0025 * np.cos(-1.5)])
    assert (reward, ended) == (-1.0, False)
    world._state = np.array([-1.19, -0.05])
    assert world.step(0)[0].tolist() == [-1.2, 0.0]


def test_cells_are_centred_on_zero() -> None:
    bins = Bins((-1.2, -0.07), (0.6, 0.07), (20, 20))
    assert bins.shape == (21, 21)
    for cell in range(bins.count):
        assert bins.number(bins.centre(cell)) == cell
    assert bins.number((0.044, 0.0)) == bins.number((-0.044, 0.0))
    assert bins.number((0.046, 0.0)) != bins.number((0.044, 0.0))
    with pytest.raises(ValueError, match="finite"):
        bins.number((np.nan, 0.0))
    with pytest.raises(ValueError, match="empty"):
        Bins((0,), (0,), (3,))


def test_whole_numbers_and_fractions_share_cells() -> None:
    bins = Bins((-2, 0), (3, 9), (5, 4))
    for state in np.random.default_rng(0).integers(-6, 14, (300, 2)):
        # by the rule, on arrays; twice, as the second answer is remembered
        cell = np.trunc((state + np.copysign(bins.width / 2, state)) / bins.width) - bins.first
        cell = np.clip(cell, 0, np.array(bins.shape) - 1).astype(int)
        expected = int(np.ravel_multi_index(tuple(cell), bins.shape))
        assert [bins.number(s) for s in (state, state, state.astype(float), state.tolist())] == [
            expected
        ] * 4
    assert bins.number((1e300, -1e300)) == bins.number((3, 0))
    for wrong in (np.array([1]), np.array([[1, 2]]), np.array([1, 2, 3]), (np.inf, 0.0)):
        with pytest.raises(ValueError, match="2 finite"):
            bins.number(wrong)


def test_moves_go_aside_as_numpy_chooses() -> None:
    ours, theirs = np.random.default_rng(3), np.random.default_rng(3)
    for direction in (NORTH, SOUTH, EAST, WEST):
        ways = (direction, *SIDES[direction])
        for _ in range(100):
            assert aside(direction, ours.random()) == ways[theirs.choice(3, p=SHARES)]
