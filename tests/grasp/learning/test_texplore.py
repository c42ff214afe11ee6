"""Trees, forests, rollouts and threads of TEXPLORE."""

from __future__ import annotations

import threading
import time
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from grasp.learning.agents.texplore import RealTimeTexplore, Texplore, TexploreSettings
from grasp.learning.agents.texplore.tree import Forest, ForestSettings, gain_ratio, uniform
from grasp.learning.environments import Bins, TwoRooms
from grasp.learning.transition import Transition

_SURE = ForestSettings(share=1.0, skip=0.0, smoothing=0.0)


def test_gain_ratio_by_hand() -> None:
    everything = np.array([4.0, 4.0])
    assert gain_ratio(np.array([4.0, 0.0]), everything) == pytest.approx(1.0)
    # H = ln 2; halves of (3,1) and (1,3): H = .5623; the test itself ln 2
    expected = (np.log(2) - 0.5623351446188083) / np.log(2)
    assert gain_ratio(np.array([3.0, 1.0]), everything) == pytest.approx(expected)
    assert gain_ratio(np.array([0.0, 0.0]), everything) == 0.0


def test_a_rule_is_learned_exactly() -> None:
    """Up moves the row by one except at the wall; 24 experiences say so."""
    forest = Forest(2, _SURE, 1e-3, seed=0)
    rule = {(row, action): float(action == 1 and row < 4) for row in range(5) for action in (0, 1)}
    for _ in range(2):
        for (row, action), change in rule.items():
            forest.add(np.array([row, action], dtype=float), change)
    for (row, action), change in rule.items():
        shares = forest.predict(np.array([row, action], dtype=float))
        assert shares[forest.outputs.index(change)] == 1.0


def test_two_unlucky_steps_make_no_wall() -> None:
    def chance_of_a_step(smoothing: float) -> float:
        forest = Forest(1, replace(_SURE, smoothing=smoothing), 1e-3, seed=1)
        for _ in range(4):
            forest.add(np.array([0.0]), 1.0)
        for _ in range(2):
            forest.add(np.array([1.0]), 0.0)
        return float(forest.predict(np.array([1.0]))[forest.outputs.index(1.0)])

    assert chance_of_a_step(0.0) == 0.0
    # The root, where 4 of 6 moved, counts for half an experience beside the two of the leaf. The
    # last one was expected, and is counted all the same.
    assert chance_of_a_step(0.5) == pytest.approx(0.5 * (4 / 6) / 2.5)


def test_without_chance_all_trees_are_one() -> None:
    forest = Forest(2, _SURE, 1e-3, seed=0)
    rng = np.random.default_rng(0)
    for _ in range(60):
        x = rng.integers(0, 4, 2).astype(float)
        forest.add(x, float(x[0] > x[1]))
    for tree in range(1, 5):
        assert (forest.nodes[tree, : forest.used[tree]] == forest.nodes[0, : forest.used[0]]).all()


def test_a_change_is_predicted_where_nothing_was_seen() -> None:
    forest = Forest(3, _SURE, 1e-3, seed=0)
    for row in (0.0, 1.0, 2.0):
        forest.add(np.array([row, 1.0, 0.0]), 1.0)
        forest.add(np.array([row, 0.0, 1.0]), -1.0)
    shares = forest.predict(np.array([7.0, 0.0, 1.0]))
    assert shares[forest.outputs.index(-1.0)] == 1.0


def test_predictions_are_distributions_whatever_was_learned() -> None:
    forest = Forest(2, ForestSettings(), 1e-3, seed=4)
    assert forest.predict(np.zeros(2)).size == 0
    rng = np.random.default_rng(1)
    for _ in range(400):
        x = rng.integers(0, 6, 2).astype(float)
        forest.add(x, float(rng.integers(0, 4)))
        shares = forest.predict(x)
        assert shares.sum() == pytest.approx(1.0)
        assert (shares >= 0).all()


def test_the_generator_is_uniform_and_repeats() -> None:
    state = np.array([7], dtype=np.uint64)
    drawn = np.array([uniform(state) for _ in range(20_000)])
    assert (drawn >= 0).all()
    assert (drawn < 1).all()
    assert drawn.mean() == pytest.approx(0.5, abs=0.009)  # four standard errors
    again = np.array([7], dtype=np.uint64)
    assert [uniform(again) for _ in range(5)] == drawn[:5].tolist()


def test_rollouts_on_a_chain_find_its_values() -> None:
    """Three states in a row, forward costs 1, the last step costs nothing and ends."""
    bins = Bins((0,), (2,), (2,))
    agent = Texplore(bins, 2, TexploreSettings(gamma=0.9, rollouts=3_000, forest=_SURE), seed=0)
    for _ in range(10):
        for state in range(3):
            here = np.array([state])
            ended = state == 2
            there = np.array([min(state + 1, 2)])
            agent.observe(Transition(here, 1, 0.0 if ended else -1.0, there, ended))
            agent.observe(Transition(here, 0, -1.0, here))
    assert [agent.act(np.array([state])) for state in range(3)] == [1, 1, 1]
    # values of forward: 0, -1 + .9 * 0, -1 + .9 * -1; rollouts average over what they tried
    forward = [agent.planner.values[bins.number([state]), 1] for state in range(3)]
    assert forward == pytest.approx([-1.9, -1.0, 0.0], abs=0.15)


def test_real_time_acts_on_time_learns_meanwhile_and_leaves_no_thread() -> None:
    world = TwoRooms()
    state, _ = world.reset(seed=0)
    with RealTimeTexplore(world.bins(), 4, seed=0, rate_hz=100) as agent:
        agent.learn_examples(world.examples())
        started = time.monotonic()
        for _ in range(30):
            action = agent.act(state)
            after, reward, ended, _, _ = world.step(action)
            agent.observe(Transition(state, action, reward, after, ended))
            state = world.reset()[0] if ended else after
        assert time.monotonic() - started >= 29 * agent.period_s * 0.95
        assert agent.wait_until_learned(timeout_s=60)
        assert agent._agent.model.reward.count == 32
    assert [one for one in threading.enumerate() if one.name.startswith("texplore")] == []
    with pytest.raises(RuntimeError, match="closed"):
        agent.act(state)


class _Unsteady(np.ndarray[Any, np.dtype[np.float64]]):
    """Values that a planner in another thread raises while their largest is looked for."""

    def max(self, *args: Any, **kwargs: Any) -> Any:
        largest = np.asarray(self).max(*args, **kwargs)
        if self.base is not None:  # a view of what the planner writes to, not a copy
            self += 1.0
        return largest


def test_values_that_change_while_they_are_compared_give_an_action() -> None:
    agent = Texplore(Bins((0,), (2,), (2,)), 3, seed=0)
    agent.planner.values = np.zeros_like(agent.planner.values).view(_Unsteady)
    assert agent.best(np.array([0])) in range(3)


@pytest.mark.slow
def test_acting_does_not_wait_for_learning() -> None:
    world = TwoRooms()
    state, _ = world.reset(seed=1)
    steps = []
    for number in range(3_000):
        after, reward, ended, _, _ = world.step(number % 4)
        steps.append(Transition(state, number % 4, reward, after, ended))
        state = world.reset()[0] if ended else after
    with RealTimeTexplore(world.bins(), 4, seed=0, rate_hz=20) as agent:
        agent.act(state)
        agent.learn_examples(steps)
        acted = 0
        while agent.is_learning and acted < 15:
            agent.act(state)
            acted += 1
        assert acted > 3  # 3,000 experiences take longer to learn than that


def test_a_failure_in_a_thread_reaches_the_caller() -> None:
    with RealTimeTexplore(TwoRooms.bins(), 4, rate_hz=200) as agent:
        agent.observe(Transition(np.array([0, 6]), 9, -1.0, np.array([0, 6])))  # no such action
        agent.wait_until_learned(timeout_s=60)
        with pytest.raises(RuntimeError, match="the learner stopped"):
            agent.act(np.array([0, 6]))
