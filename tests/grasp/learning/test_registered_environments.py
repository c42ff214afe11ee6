"""The environments by their registered names: gymnasium's own check, limits, many side by side."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import dataclass
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

from grasp.learning.agents import QLearning, run_episodes
from grasp.learning.env import Candidate, Outcome, Problem
from grasp.learning.environments import TwoRooms, simulated_grasps
from grasp.learning.registration import ENVIRONMENTS
from grasp.learning.simulated import WorldSettings, make_world


@dataclass(frozen=True)
class _Grasp:
    theta: float
    quality: float


def _holds_at_right_angles(_: Problem, candidate: Candidate) -> Outcome:
    return Outcome(abs(candidate.theta - np.pi / 2) < 0.1)


_PROBLEMS = [
    Problem(f"box {k}", np.full(5, 0.1 * k), [_Grasp(theta, 0.5) for theta in angles])
    for k, angles in enumerate([(0.1, 1.6, 3.0), (1.6, 4.0), (0.2, 5.0)])
]
_GRASP: dict[str, Any] = {"problems": _PROBLEMS, "outcome": _holds_at_right_angles}
_FEW: dict[str, Any] = {"objects": 3, "families": 2}
_ONE_OBJECT = WorldSettings(families=1, objects=1, runs=2, samples=5)
_WORLDS = [
    ("rtask/TwoRooms-v0", {}),
    ("rtask/Taxi-v0", {"stochastic": False}),
    ("rtask/MountainCar-v0", {}),
    ("rtask/Grasp-v0", _GRASP),
    ("rtask/Grasp-v0", {**_GRASP, "shuffled": True}),
    pytest.param("rtask/SimulatedGrasps-v0", _FEW, marks=pytest.mark.slow),
]


@pytest.mark.parametrize(("name", "options"), _WORLDS)
@pytest.mark.filterwarnings("ignore:.*infinity. This is probably too:UserWarning")
def test_gymnasium_finds_no_fault(name: str, options: dict[str, Any]) -> None:
    check_env(gymnasium.make(name, **options).unwrapped)


@pytest.mark.parametrize(("name", "options"), _WORLDS)
def test_a_seed_repeats_a_life_from_any_point(name: str, options: dict[str, Any]) -> None:
    world = gymnasium.make(name, **options)
    actions = np.random.default_rng(0).integers(world.action_space.n, size=60)  # type: ignore[attr-defined]

    def live() -> list[Any]:
        seen = [world.reset(seed=7)[0].tolist()]
        for action in actions.tolist():
            after, reward, ended, cut, _ = world.step(action)
            seen.append((after.tolist(), reward, ended, cut))
            if ended or cut:
                seen.append(world.reset()[0].tolist())
        return seen

    assert live() == live()


def test_the_grasp_problem_needs_no_arguments(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(simulated_grasps, "make_world", lambda _: make_world(_ONE_OBJECT))
    world = gymnasium.make("rtask/Grasp-v0")
    view, info = world.reset(seed=1)
    assert view.shape == (5,)
    assert info["candidates"] > 0
    assert world.step(int(info["action_mask"].argmax()))[1] in (-1.0, 1.0)
    for given, missing in (("problems", "outcome"), ("outcome", "problems")):
        with pytest.raises(ValueError, match=f"{missing} is missing"):
            gymnasium.make("rtask/Grasp-v0", **{given: _GRASP[given]})


@pytest.mark.parametrize("name", ENVIRONMENTS)
@pytest.mark.parametrize("mode", ["human", "rgb_array"])
@pytest.mark.filterwarnings("ignore:.*not in the possible render_modes:UserWarning")
def test_no_environment_has_a_picture_and_that_is_said(name: str, mode: str) -> None:
    for options in ({}, _GRASP) if name == "rtask/Grasp-v0" else ({},):
        with pytest.raises(gymnasium.error.UnsupportedMode, match="leave render_mode out"):
            gymnasium.make(name, render_mode=mode, **options)


@pytest.mark.parametrize(
    "name",
    ["TwoRooms", pytest.param("Grasp", marks=pytest.mark.deep)],  # 2 s to lay out its objects
)
def test_a_name_with_its_module_needs_no_import(name: str) -> None:
    program = (
        "import gymnasium\n"
        f"world = gymnasium.make('grasp.learning.environments:rtask/{name}-v0')\n"
        "print(world.reset(seed=1)[0].shape)"
    )
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("(")


@pytest.mark.parametrize("name", ["TwoRooms", "Taxi", "MountainCar"])
def test_episodes_are_cut_off_inside(name: str) -> None:
    world = gymnasium.make(f"rtask/{name}-v0", max_episode_steps=5)
    assert gymnasium.spec(f"rtask/{name}-v0").max_episode_steps == 1000
    world.reset(seed=1)
    ends = [world.step(0)[2:4] for _ in range(5)]
    assert ends == [(False, False)] * 4 + [(False, True)]


def test_learners_live_the_same_behind_the_limit() -> None:
    lives = []
    for world in (TwoRooms(), gymnasium.make("rtask/TwoRooms-v0")):
        agent = QLearning(TwoRooms.bins(), 4, seed=2)
        lives.append([(e.reward, e.steps) for e in run_episodes(agent, world, 5, seed=3)])
    assert lives[0] == lives[1]


@pytest.mark.parametrize(("name", "options"), _WORLDS)
def test_environments_side_by_side(name: str, options: dict[str, Any]) -> None:
    worlds = gymnasium.make_vec(name, num_envs=3, vectorization_mode="sync", **options)
    alone = gymnasium.make(name, **options)
    states, _ = worlds.reset(seed=5)
    rng = np.random.default_rng(1)
    second, over = alone.reset(seed=6)[0], False
    for _ in range(40):
        assert (states[1] == second).all()
        actions = rng.integers(worlds.single_action_space.n, size=3)  # type: ignore[attr-defined]
        states, _, ended, cut, _ = worlds.step(actions)
        if over:  # the step after an episode's last one begins the next
            (second, _), over = alone.reset(), False
        else:
            second, _, alone_ended, alone_cut, _ = alone.step(int(actions[1]))
            over = alone_ended or alone_cut
            assert (ended[1], cut[1]) == (alone_ended, alone_cut)
    worlds.close()


@pytest.mark.slow
def test_environments_in_processes_of_their_own() -> None:
    kinds = [
        gymnasium.make_vec("rtask/Grasp-v0", 2, mode, **_GRASP, shuffled=True)
        for mode in ("sync", "async")
    ]
    lives = []
    for worlds in kinds:
        seen = [worlds.reset(seed=4)[0].tolist()]
        for action in range(20):
            states, rewards, _, cut, info = worlds.step(np.array([action % 4, 1]))
            seen.append((states.tolist(), rewards.tolist(), cut.tolist(), info["left"].tolist()))
        worlds.close()
        lives.append(seen)
    assert lives[0] == lives[1]


def test_shuffled_objects_differ_side_by_side() -> None:
    worlds = gymnasium.make_vec(
        "rtask/Grasp-v0", 8, vectorization_mode="sync", **_GRASP, shuffled=True
    )
    assert len(set(worlds.reset(seed=0)[1]["object"])) > 1
    worlds.close()


@pytest.mark.slow
@pytest.mark.parametrize(("quality", "fewer"), [("good", True), (None, False)])
def test_quality_orders_the_candidates_of_a_quadrant(quality: str | None, fewer: bool) -> None:
    world = gymnasium.make("rtask/SimulatedGrasps-v0", quality=quality, **_FEW)
    rng, steps = np.random.default_rng(0), []
    for episode in range(150):
        _, info = world.reset(seed=3 if episode == 0 else None)
        over, count = False, 0
        while not over:
            action = int(rng.choice(np.flatnonzero(info["action_mask"])))
            _, _, ended, cut, info = world.step(action)
            over, count = ended or cut, count + 1
        steps.append(count)
    # random quadrants take 1.3 attempts with candidates by quality and 3.1 without
    # (docs/learning.md, Side by side)
    assert bool(np.mean(steps) < 2) is fewer


def test_simulated_objects_must_be_some() -> None:
    with pytest.raises(ValueError, match="objects and families"):
        gymnasium.make("rtask/SimulatedGrasps-v0", objects=0)
    with pytest.raises(ValueError, match="expected 'good', 'poor'"):
        gymnasium.make("rtask/SimulatedGrasps-v0", quality="best")


def test_gymnasium_knows_them_by_the_import_of_the_package_alone() -> None:
    text = (
        "import gymnasium\nimport rtask\nimport sys\n"
        "assert 'grasp.learning.environments' not in sys.modules\n"
        "world = gymnasium.make('rtask/Grasp-v0')\n"
        "world.reset(seed=0)\n"
        "assert len(world.step(world.action_space.sample())) == 5\n"
    )
    subprocess.run([sys.executable, "-W", "error", "-c", text], check=True, timeout=120)
