"""The grasp problem with quadrants as actions, and the five numbers of its state."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

from grasp.learning.agents import QLearning, run_episodes
from grasp.learning.env import MAX_ATTEMPTS, Candidate, GraspEnv, Outcome, Problem
from grasp.learning.environments import Bins
from grasp.learning.state import GrowingComponents, pooled


@dataclass(frozen=True)
class _Grasp:
    theta: float
    quality: float


def _problem(name: str = "mug", *angles: float) -> Problem:
    grasps = [_Grasp(np.radians(a), 1 - n / 10) for n, a in enumerate(angles or (10, 20, 100, 190))]
    return Problem(name, np.zeros(5), grasps)


def _at(degrees: float) -> object:
    def outcome(_: Problem, candidate: Candidate) -> Outcome:
        return Outcome(abs(candidate.theta - np.radians(degrees)) < 1e-9)

    return outcome


@pytest.mark.filterwarnings("ignore:.*infinity. This is probably too:UserWarning")
def test_gymnasium_finds_no_fault() -> None:
    check_env(GraspEnv([_problem()], _at(190)), skip_render_check=True)  # type: ignore[arg-type]


def test_the_best_candidate_of_a_quadrant_goes_first_and_once() -> None:
    env = GraspEnv([_problem()], _at(190))  # type: ignore[arg-type]
    env.reset()
    tried = [env.step(0)[4].get("candidate") for _ in range(3)]
    assert tried == [0, 1, None]
    _, reward, ended, cut, info = env.step(2)
    assert (reward, ended, cut) == (1.0, True, False)
    assert info["confirmed_by"] == "physics"


def test_an_empty_quadrant_costs_and_tries_nothing() -> None:
    env = GraspEnv([_problem()], _at(190))  # type: ignore[arg-type]
    _, info = env.reset()
    assert info["action_mask"].tolist() == [True, True, True, False]
    _, reward, ended, cut, info = env.step(3)
    assert (reward, ended, cut, info["empty"]) == (-1.0, False, False, True)
    assert "candidate" not in info


def test_twelve_attempts_are_enough() -> None:
    env = GraspEnv([_problem()], _at(-1))  # type: ignore[arg-type]
    env.reset()
    steps = [env.step(n % 4)[2:4] for n in range(MAX_ATTEMPTS)]
    assert steps == [(False, False)] * (MAX_ATTEMPTS - 1) + [(False, True)]


def test_an_outcome_that_nobody_confirms_teaches_nothing() -> None:
    env = GraspEnv([_problem()], lambda p, c: Outcome(None, "human"))
    env.reset()
    _, reward, ended, cut, info = env.step(0)
    assert (reward, ended, cut, info["unlabelled"]) == (0.0, False, True, True)


def test_objects_come_in_turn_or_by_name() -> None:
    env = GraspEnv([_problem("mug"), _problem("pen")], _at(10))  # type: ignore[arg-type]
    assert [env.reset()[1]["object"] for _ in range(3)] == ["mug", "pen", "mug"]
    assert env.reset(options={"object": "pen"})[1]["object"] == "pen"
    with pytest.raises(ValueError, match="no object 'cup'"):
        env.reset(options={"object": "cup"})


def test_bad_problems_are_refused() -> None:
    with pytest.raises(ValueError, match="candidate 1 is not finite"):
        Problem("mug", np.zeros(5), [_Grasp(0, 1), _Grasp(0, float("nan"))])
    with pytest.raises(ValueError, match="finite features"):
        Problem("mug", np.zeros(4), [])
    with pytest.raises(ValueError, match="same name"):
        GraspEnv([_problem(), _problem()], _at(0))  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="no object"):
        GraspEnv([], _at(0))  # type: ignore[arg-type]


def test_a_table_learner_finds_the_quadrant() -> None:
    env = GraspEnv([_problem("mug", 10, 20, 30, 190)], _at(190))  # type: ignore[arg-type]
    agent = QLearning(Bins((-3,) * 5, (3,) * 5, (2,) * 5), 4, seed=0)
    steps = [episode.steps for episode in run_episodes(agent, env, 40)]
    assert np.mean(steps[20:]) < 1.5  # one, and an exploring action now and then


def test_pooling_a_view() -> None:
    rows = np.vstack([np.full(128, 1.0), np.full(128, 3.0)])
    view, seen = pooled(rows)
    assert seen
    assert (view[:128] == 2.0).all()
    assert (view[128:] == 1.0).all()
    assert pooled(np.zeros((0, 128)))[1] is False
    with pytest.raises(ValueError, match="finite"):
        pooled(np.full((1, 128), np.nan))


def test_components_grow_into_those_of_all_views() -> None:
    rng = np.random.default_rng(0)
    directions = rng.normal(size=(5, 20)) * np.array([9, 7, 5, 3, 2])[:, None]
    views = rng.normal(size=(120, 5)) @ directions + 0.01 * rng.normal(size=(120, 20)) + 4.0
    growing = GrowingComponents(20)
    changes = [growing.add(view) for view in views]
    assert [n + 1 for n, changed in enumerate(changes) if changed] == [30, 60, 120]
    states = np.array([growing.state(view).features for view in views])
    assert growing.state(views[0]).version == 3
    assert states.mean(axis=0) == pytest.approx(np.zeros(5), abs=1e-9)
    assert states.std(axis=0) == pytest.approx(np.ones(5), abs=1e-9)
    copy = GrowingComponents(20, seed=9)
    copy.take(growing.arrays())
    assert (copy.state(views[5]).features == growing.state(views[5]).features).all()
    with pytest.raises(ValueError, match="20 finite"):
        growing.add(np.zeros(3))
