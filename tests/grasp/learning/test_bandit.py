"""Beliefs by hand, kernel limits, determinism, stopping."""

from __future__ import annotations

import numpy as np
import pytest

from grasp.learning.bandit import Arm, BetaThompson, Policy, Trial, choose, kernel

HERE = (0.0, 0.0, 0.03)
SIZE = 0.08


def test_beliefs_equal_the_formula_computed_by_hand():
    arm = Arm(HERE, 0.0, quality=0.75, successes=2.0, failures=1.0)
    alpha, beta = BetaThompson(size_m=SIZE).beliefs([arm])[0]
    assert alpha == pytest.approx(0.3 + 2 * 0.75 + 2)
    assert beta == pytest.approx(0.3 + 2 * 0.25 + 1)


def test_an_arm_without_quality_has_no_geometric_prior():
    assert BetaThompson().beliefs([Arm(HERE, 0.0)])[0].tolist() == [0.3, 0.3]


def test_the_graph_never_outweighs_the_cap():
    arm = Arm(HERE, 0.0, successes=30.0, failures=10.0)
    alpha, beta = BetaThompson().beliefs([arm])[0]
    assert alpha - 0.3 == pytest.approx(6.0)
    assert beta - 0.3 == pytest.approx(2.0)


def test_a_failure_in_the_episode_counts_rho_times():
    belief = BetaThompson(Policy(rho=2.0), SIZE).beliefs(
        [Arm(HERE, 0.0)], [Trial(HERE, 0.0, False), Trial(HERE, 0.0, True)]
    )
    assert belief[0].tolist() == pytest.approx([1.3, 2.3])


def test_kernel_is_1_at_home_and_fades_in_every_coordinate():
    home = np.zeros((1, 3))
    away = np.array([[SIZE / 4 * 0.2, 0, 0], [0, 0, SIZE / 4 * 0.2], [SIZE, 0, 0]])
    k = kernel(home, np.zeros(1), away, np.zeros(3), SIZE)[0]
    assert k[:2] == pytest.approx(np.exp(-0.5))
    assert k[2] < 1e-6
    turned = kernel(home, np.zeros(1), home, np.array([0.2]), SIZE)[0, 0]
    assert turned == pytest.approx(np.exp(-0.5), rel=0.02)  # sin(0.2) for 0.2


def test_a_closing_direction_and_its_opposite_are_one_grasp():
    home = np.zeros((1, 3))
    assert kernel(home, np.zeros(1), home, np.array([np.pi]), SIZE)[0, 0] == pytest.approx(1.0)


def test_a_push_and_its_opposite_are_two_grasps():
    home = np.zeros((1, 3))
    turned = [kernel(home, np.zeros(1), home, np.array([t]), SIZE, period=2 * np.pi)[0, 0]
              for t in (0.2, np.pi, 2 * np.pi)]  # fmt: skip
    assert turned[0] == pytest.approx(np.exp(-0.5), rel=0.02)
    assert turned[1] < 1e-9
    assert turned[2] == pytest.approx(1.0)


def test_a_failed_grasp_drags_its_neighbours_down_and_leaves_the_others():
    arms = [Arm(HERE, 0.0, 0.8), Arm(HERE, 0.1, 0.8), Arm(HERE, 1.5, 0.8)]
    before = BetaThompson(size_m=SIZE).beliefs(arms)
    after = BetaThompson(size_m=SIZE).beliefs(arms, [Trial(HERE, 0.0, False)])
    lost = after[:, 1] - before[:, 1]
    assert lost[0] == pytest.approx(2.0)
    assert 0.5 < lost[1] < 2.0
    assert lost[2] < 1e-4


def test_order_does_not_depend_on_the_order_of_arms_and_trials():
    rng = np.random.default_rng(5)
    arms = [
        Arm(tuple(rng.normal(0, 0.02, 3)), rng.uniform(0, np.pi), rng.uniform(0.3, 0.9),
            float(rng.integers(0, 3)), float(rng.integers(0, 3)))
        for _ in range(40)
    ]  # fmt: skip
    trials = [Trial(tuple(rng.normal(0, 0.02, 3)), 1.0, bool(k % 2)) for k in range(5)]
    learner = BetaThompson(Policy(selection="thompson"), SIZE)
    first = [choice.index for choice in learner.rank(arms, trials, seed=7)]
    shuffle = rng.permutation(len(arms))
    again = learner.rank([arms[i] for i in shuffle], trials[::-1], seed=7)
    assert [shuffle[choice.index] for choice in again] == first
    assert first != [choice.index for choice in learner.rank(arms, trials, seed=8)]


def test_thompson_only_samples_among_the_best_by_mean():
    arms = [Arm((0.001 * i, 0.0, 0.03), 0.0, 0.9 - 0.05 * i) for i in range(10)]
    learner = BetaThompson(Policy(selection="thompson", top_k=3), SIZE)
    firsts = {learner.rank(arms, seed=seed)[0].index for seed in range(60)}
    assert firsts == {0, 1, 2}


def test_what_causes_tell_apart_is_not_left_to_chance():
    def arms(lowered: float) -> list[Arm]:
        qualities = (0.80, 0.84, 0.82)
        return [Arm((0.03 * i, 0.0, 0.03), 0.0, q) for i, q in enumerate(qualities)] + [
            Arm((-0.04, 0.0, 0.03), 0.0, 0.95, hidden=lowered)
        ]

    learner = BetaThompson(size_m=SIZE)
    told = [learner.rank(arms(0.5), seed=seed)[0] for seed in range(20)]
    assert {choice.index for choice in told} == {1}
    assert told[0].explanation["selected_by"] == "mean"
    untold = [learner.rank(arms(0.96), seed=seed)[0] for seed in range(20)]
    assert len({choice.index for choice in untold}) > 1
    assert untold[0].explanation["selected_by"] == "sample"


def test_mean_takes_the_best_mean_for_any_seed():
    arms = [Arm((0.001 * i, 0.0, 0.03), 0.0, 0.5 + 0.04 * i) for i in range(10)]
    learner = BetaThompson(Policy(selection="mean"), SIZE)
    assert {learner.rank(arms, seed=seed)[0].index for seed in range(10)} == {9}


def test_what_worked_before_goes_first_even_if_geometry_likes_another_better():
    arms = [Arm(HERE, 0.0, 0.95), Arm(HERE, 1.0, 0.6, successes=1.0)]
    for seed in range(20):
        best = BetaThompson(size_m=SIZE).rank(arms, seed=seed)[0]
        assert best.index == 1
        assert best.explanation["selected_by"] == "proven"


def test_what_held_itself_goes_before_a_neighbour_that_rates_better_until_something_fails():
    beside = (0.008, 0.0, 0.03)
    arms = [
        Arm(beside, 0.0, quality=0.95, successes=1.5),
        Arm(HERE, 0.0, quality=0.5, successes=1.9, own_successes=1.0),
        Arm(beside, 0.1, quality=0.7, successes=1.2, own_successes=0.5),
    ]
    learner = BetaThompson(size_m=SIZE)
    first = learner.rank(arms)
    assert [choice.index for choice in first] == [1, 0, 2]
    assert first[0].mean < first[1].mean
    assert {choice.explanation["selected_by"] for choice in first} == {"proven"}
    failed = Trial((0.05, 0.0, 0.03), 0.0, success=False)
    assert learner.rank(arms, [failed])[0].index == 0


def test_what_mostly_failed_before_is_not_proven():
    arms = [Arm(HERE, 0.0, 0.95), Arm(HERE, 1.0, 0.6, successes=1.0, failures=3.0)]
    learner = BetaThompson(Policy(top_k=1), SIZE)
    assert learner.rank(arms)[0].index == 0


def test_explanation_adds_up_to_the_belief():
    arm = Arm(HERE, 0.0, 0.7, successes=12.0, failures=4.0)
    choice = choose([arm], trials=[Trial(HERE, 0.0, False)], size_m=SIZE)
    parts = np.array([choice.explanation[key] for key in ("prior", "graph", "episode")])
    assert parts.sum(axis=0).tolist() == pytest.approx([choice.alpha, choice.beta])
    assert choice.mean == pytest.approx(choice.alpha / (choice.alpha + choice.beta))
    assert choice.interval90[0] < choice.mean < choice.interval90[1]


def test_interval_holds_nine_tenths_of_the_belief():
    choice = choose([Arm(HERE, 0.0, 0.5)], size_m=SIZE)
    draws = np.random.default_rng(0).beta(choice.alpha, choice.beta, 20_000)
    low, high = choice.interval90
    assert np.mean((draws > low) & (draws < high)) == pytest.approx(0.9, abs=0.01)


def test_nothing_is_chosen_when_nothing_is_worth_it():
    hopeless = Arm(HERE, 0.0, 0.02, failures=8.0)
    assert choose([hopeless]) is None
    assert choose([]) is None
    tired = [Trial((1.0, 1.0, 1.0), 0.0, False)] * 12
    assert choose([Arm(HERE, 0.0, 0.9)], trials=tired, size_m=SIZE) is None


@pytest.mark.parametrize(
    "arm",
    [
        Arm(HERE, 0.0, float("nan")),
        Arm(HERE, 0.0, 1.2),
        Arm(HERE, 0.0, 0.5, successes=-1.0),
        Arm((0.0, float("inf"), 0.0), 0.0, 0.5),
        Arm(HERE, 0.0, 0.5, hidden=float("nan")),
    ],
)
def test_a_number_that_is_none_is_an_error_naming_the_arm(arm):
    with pytest.raises(ValueError, match="arm 1"):
        BetaThompson().beliefs([Arm(HERE, 0.0, 0.5), arm])


def test_failures_send_the_search_elsewhere_until_it_succeeds():
    arms = [Arm(HERE, k * np.pi / 12, 0.8) for k in range(12)]
    learner = BetaThompson(size_m=SIZE)
    tries = []
    for seed in range(20):
        trials: list[Trial] = []
        while not (trials and trials[-1].success):
            best = learner.rank(arms, trials, seed=100 * seed + len(trials))[0].index
            assert arms[best].theta not in [trial.theta for trial in trials]
            trials.append(Trial(HERE, arms[best].theta, best in (5, 6, 7)))
        tries.append(len(trials))
    # Three of twelve directions work: drawing with replacement takes 4 tries on average.
    assert np.mean(tries) < 4


def test_attempts_nowhere_and_objects_of_no_size_are_refused():
    arms, nowhere = [Arm(HERE, 0.0, 0.5)], Trial((float("nan"), 0.0, 0.0), 0.0, success=False)
    with pytest.raises(ValueError, match="trial 0"):
        BetaThompson().rank(arms, [nowhere])
    with pytest.raises(ValueError, match="size_m"):
        BetaThompson(size_m=float("nan")).rank(arms, [Trial(HERE, 0.0, success=False)])
