"""A Bayesian bandit over grasp candidates, with what other robots learned as prior.

Each candidate i of the present object is an arm with a belief Beta(alpha, beta) about its success:

    alpha_i = floor + kappa q_i       + c A_i + sum_t k(i, t) s_t
    beta_i  = floor + kappa (1 - q_i) + c B_i + rho sum_t k(i, t) (1 - s_t)

q is the quality by geometry, less what attempts say of hidden causes
(:mod:`grasp.learning.causes`). A and B are weighted successes and failures from the graph with
c = min(1, cap / (A + B)), and t runs over the attempts on this very object in this episode, which
teach about neighbouring grasps through the kernel k. The grasp problem of Gatto 2016, 3.3.4 has no
dynamics: one choice, one outcome. That is a bandit, and candidates make better arms than the four
quadrants of theta.

Nothing is trained beforehand, and the same arms, attempts and seed give the same choice, in
whatever order they come.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

__all__ = ["Arm", "Axes", "BetaThompson", "Choice", "Policy", "Trial", "choose", "kernel",
           "kernel_in_space"]  # fmt: skip

Selection = Literal["auto", "thompson", "mean"]
Axes = tuple[tuple[float, float, float], tuple[float, float, float]]


@dataclass(frozen=True)
class Policy:
    """Parameters of belief and of the choice of an arm.

    Parameters
    ----------
    kappa
        Strength of the geometric quality, in pseudo-attempts.
    cap
        Attempts that the graph's counts are worth at most.
    rho
        Weight of a failure in this episode: a motionless object fails the same way again.
    floor
        Pseudo-count of success and of failure that every arm starts with.
    bandwidth
        Distance, in units of :func:`kernel`, over which attempts speak for their neighbours.
    selection
        ``thompson``: sample among the ``top_k`` best; ``mean``: the best mean; ``auto``:
        ``thompson``, but proven arms go first, by mean; at the first attempt of an episode those
        that held themselves before those beside such ones.
    proven_weight, proven_share, proven_mean
        An arm is proven when its evidence holds that many successes, their share of its evidence
        is that large, and so is its mean.
    telling
        Where causes leave so much more of the quality of one arm than of another's, the best mean
        goes first and nothing is sampled.
    stop_below
        When no arm has a larger mean, the answer is "no grasp".
    max_trials
        So many attempts in one episode also end it.
    """

    kappa: float = 2.0
    cap: float = 8.0
    rho: float = 2.0
    floor: float = 0.3
    bandwidth: float = 0.2
    selection: Selection = "auto"
    top_k: int = 5
    proven_weight: float = 0.8
    proven_share: float = 0.6
    proven_mean: float = 0.5
    telling: float = 0.05
    stop_below: float = 0.1
    max_trials: int = 12


@dataclass(frozen=True)
class Arm:
    """One candidate grasp and what is known about it.

    Parameters
    ----------
    position : (x, y, z), m
        In the frame that all arms and trials share.
    theta
        Closing direction, rad.
    quality
        0..1 by geometry, or None when nothing is known by geometry.
    successes, failures
        Weighted counts from the graph (A and B).
    opening
        m; tells arms apart that differ in nothing else.
    axes
        Closing and approach direction, unit vectors, of a grasp in space; None = from above,
        closing along theta.
    hidden
        Factor on the quality, 0..1, for what attempts say of causes that cannot be seen; see
        :mod:`grasp.learning.causes`.
    own_successes
        Of ``successes``, those of this very grasp and not of grasps beside it.
    """

    position: tuple[float, float, float]
    theta: float
    quality: float | None = None
    successes: float = 0.0
    failures: float = 0.0
    opening: float = 0.0
    axes: Axes | None = None
    hidden: float = 1.0
    own_successes: float = 0.0


@dataclass(frozen=True)
class Trial:
    """An attempt on this very object in this episode."""

    position: tuple[float, float, float]
    theta: float
    success: bool
    axes: Axes | None = None


@dataclass(frozen=True)
class Choice:
    """One arm in the learner's order.

    Parameters
    ----------
    index
        Of the arm, in the order given.
    alpha, beta
        Belief about its success.
    mean, interval90
        Of that belief.
    explanation
        What the belief is made of, JSON-able.
    """

    index: int
    mean: float
    interval90: tuple[float, float]
    alpha: float
    beta: float
    explanation: dict[str, Any]


def kernel(
    positions: NDArray[np.float64],
    thetas: NDArray[np.float64],
    other_positions: NDArray[np.float64],
    other_thetas: NDArray[np.float64],
    size_m: float,
    bandwidth: float = 0.2,
    period: float = np.pi,
) -> NDArray[np.float64]:
    """Return how much grasps say about each other, (n, m), 1 for the same grasp.

    exp(-d^2 / 2h^2), where d takes a quarter of the object's size and one radian of closing
    direction as units.

    Parameters
    ----------
    positions, other_positions : (n, 3), (m, 3), m
    thetas, other_thetas : (n,), (m,), rad
    size_m
        Largest extent of the object.
    period
        Turn after which a grasp is the same: half a turn for two fingers that close towards each
        other, a whole one for a push.

    Examples
    --------
    >>> here, turned = np.zeros((1, 3)), np.array([0.2])
    >>> round(float(kernel(here, np.zeros(1), here, turned, 0.1)[0, 0]), 2)
    0.61
    """
    if not 0 < size_m < np.inf:
        raise ValueError(f"size_m must be positive, got {size_m}")

    def features(p: NDArray[np.float64], t: NDArray[np.float64]) -> NDArray[np.float64]:
        turns = 2 * np.pi / period
        axis = np.stack([np.cos(turns * t), np.sin(turns * t)], axis=1) / turns
        return np.concatenate([p.reshape(-1, 3) / (size_m / 4), axis], axis=1)

    a, b = features(positions, thetas), features(other_positions, other_thetas)
    squared = np.sum((a[:, None, :] - b[None, :, :]) ** 2, axis=2)
    return np.asarray(np.exp(-squared / (2 * bandwidth**2)))


def kernel_in_space(
    positions: NDArray[np.float64],
    axes: NDArray[np.float64],
    other_positions: NDArray[np.float64],
    other_axes: NDArray[np.float64],
    size_m: float,
    bandwidth: float = 0.2,
) -> NDArray[np.float64]:
    """Return :func:`kernel` of grasps from any direction, (n, m): among those from above the same.

    Parameters
    ----------
    positions, other_positions : (n, 3), (m, 3), m
    axes, other_axes : (n, 2, 3), (m, 2, 3)
        Closing direction, whose sign does not matter, and approach, unit vectors. One rad of either
        is a unit.

    Examples
    --------
    >>> here, above, side = np.zeros((1, 3)), [[[1, 0, 0], [0, 0, -1]]], [[[1, 0, 0], [0, 1, 0]]]
    >>> round(float(kernel_in_space(here, np.array(above), here, np.array(side), 0.1)[0, 0]), 2)
    0.0
    """
    if not 0 < size_m < np.inf:
        raise ValueError(f"size_m must be positive, got {size_m}")

    def features(p: NDArray[np.float64], a: NDArray[np.float64]) -> NDArray[np.float64]:
        line = np.einsum("ni,nj->nij", a[:, 0], a[:, 0]).reshape(-1, 9) / np.sqrt(2)
        return np.concatenate([p.reshape(-1, 3) / (size_m / 4), line, a[:, 1]], axis=1)

    a, b = features(positions, axes), features(other_positions, other_axes)
    squared = np.sum((a[:, None, :] - b[None, :, :]) ** 2, axis=2)
    return np.asarray(np.exp(-squared / (2 * bandwidth**2)))


def _axes(source: Arm | Trial) -> Axes:
    if source.axes is not None:
        return source.axes
    return (float(np.cos(source.theta)), float(np.sin(source.theta)), 0.0), (0.0, 0.0, -1.0)


class BetaThompson:
    """Orders arms by belief.

    Parameters
    ----------
    policy
    size_m
        Largest extent of the object, the scale of the kernel.
    period
        Turn after which a grasp is the same, rad; see :func:`kernel`.

    Examples
    --------
    >>> arms = [Arm((0.0, 0.0, 0.03), 0.0, quality=0.9), Arm((0.0, 0.0, 0.03), 1.5, quality=0.6)]
    >>> failed = Trial((0.0, 0.0, 0.03), 0.0, success=False)
    >>> learner = BetaThompson(Policy(selection="mean"), size_m=0.08)
    >>> [choice.index for choice in learner.rank(arms)]
    [0, 1]
    >>> [choice.index for choice in learner.rank(arms, [failed, failed])]
    [1, 0]
    """

    def __init__(
        self, policy: Policy | None = None, size_m: float = 0.1, period: float = np.pi
    ) -> None:
        self.policy = policy or Policy()
        self.size_m = size_m
        self.period = period

    def beliefs(self, arms: Sequence[Arm], trials: Sequence[Trial] = ()) -> NDArray[np.float64]:
        """Return alpha and beta of each arm, (n, 2).

        Raises
        ------
        ValueError
            Naming the arm or the trial whose numbers are not finite or not in range.
        """
        policy = self.policy
        for i, arm in enumerate(arms):
            numbers = (*arm.position, arm.theta, arm.successes, arm.failures)
            if not all(np.isfinite(v) for v in numbers) or min(arm.successes, arm.failures) < 0:
                raise ValueError(f"arm {i}: pose and counts must be finite, counts >= 0: {arm}")
            if arm.quality is not None and not 0 <= arm.quality <= 1:
                raise ValueError(f"arm {i}: quality must lie in 0..1, got {arm.quality}")
            if not 0 <= arm.hidden <= 1:
                raise ValueError(f"arm {i}: hidden must lie in 0..1, got {arm.hidden}")
        for i, trial in enumerate(trials):
            if not all(np.isfinite(v) for v in (*trial.position, trial.theta)):
                raise ValueError(f"trial {i}: its pose must be finite: {trial}")
        belief = np.full((len(arms), 2), policy.floor)
        for i, arm in enumerate(arms):
            if arm.quality is not None:
                quality = arm.quality * arm.hidden
                belief[i] += policy.kappa * np.array([quality, 1 - quality])
            belief[i] += self._share(arm) * np.array([arm.successes, arm.failures])
        return belief + self._own(arms, trials)

    def rank(
        self, arms: Sequence[Arm], trials: Sequence[Trial] = (), seed: int = 0
    ) -> list[Choice]:
        """Return all arms in the order in which to try them; the first is the choice.

        Returns
        -------
        Empty when there is no arm, none is worth trying, or the episode has gone on long enough.
        """
        if not arms or len(trials) >= self.policy.max_trials:
            return []
        belief = self.beliefs(arms, trials)
        mean = belief[:, 0] / belief.sum(axis=1)
        if mean.max() < self.policy.stop_below:
            return []
        canonical = sorted(range(len(arms)), key=lambda i: _geometry(arms[i]))
        score = self._scores(arms, belief, mean, canonical, seed, is_first=not trials)
        place = {arm: k for k, arm in enumerate(canonical)}
        order = sorted(range(len(arms)), key=lambda i: (*(-s for s in score[i]), place[i]))
        own = self._own(arms, trials)
        intervals = _interval90(belief)
        return [
            Choice(
                index=i,
                mean=float(mean[i]),
                interval90=(float(intervals[i, 0]), float(intervals[i, 1])),
                alpha=float(belief[i, 0]),
                beta=float(belief[i, 1]),
                explanation=self._explain(arms[i], own[i], score[i]),
            )
            for i in order
        ]

    def _share(self, arm: Arm) -> float:
        total = arm.successes + arm.failures
        return min(1.0, self.policy.cap / total) if total > 0 else 1.0

    def _own(self, arms: Sequence[Arm], trials: Sequence[Trial]) -> NDArray[np.float64]:
        """Return what this episode adds to alpha and beta, (n, 2)."""
        if not trials or not arms:
            return np.zeros((len(arms), 2))
        k = self._kernel(arms, trials)
        # Two sums in a canonical order would be exact; rounding makes any order give one result.
        won = np.array([trial.success for trial in trials], dtype=np.float64)
        sums = np.stack([k @ won, self.policy.rho * (k @ (1 - won))], axis=1)
        return np.asarray(np.round(sums, 9))

    def _kernel(self, arms: Sequence[Arm], trials: Sequence[Trial]) -> NDArray[np.float64]:
        here = np.array([arm.position for arm in arms])
        there = np.array([trial.position for trial in trials])
        size_m, bandwidth = self.size_m, self.policy.bandwidth
        flat = all(arm.axes is None for arm in arms)
        if flat and all(trial.axes is None for trial in trials):
            thetas = np.array([arm.theta for arm in arms])
            tried = np.array([trial.theta for trial in trials])
            return kernel(here, thetas, there, tried, size_m, bandwidth, self.period)
        turns = np.array([_axes(arm) for arm in arms])
        tried = np.array([_axes(trial) for trial in trials])
        return kernel_in_space(here, turns, there, tried, size_m, bandwidth)

    def _scores(
        self,
        arms: Sequence[Arm],
        belief: NDArray[np.float64],
        mean: NDArray[np.float64],
        canonical: list[int],
        seed: int,
        is_first: bool,
    ) -> list[tuple[float, float]]:
        """Return (stage, value) of each arm; larger goes first."""
        policy = self.policy
        scores = [(0.0, float(m)) for m in mean]
        informed = policy.kappa > 0 and any(arm.quality is not None for arm in arms)
        # A sample of a belief as wide as that of a few attempts is close to any of the five best,
        # which forgets what causes told apart. Their hypotheses explore by themselves: each failure
        # moves the best mean to where the likely ones say that it holds.
        undecided = informed and not self._told_apart(arms)
        if policy.selection == "thompson" or (policy.selection == "auto" and undecided):
            best = sorted(canonical, key=lambda i: -round(float(mean[i]), 9))[: policy.top_k]
            rng = np.random.default_rng(seed)
            for i in canonical:
                if i in best:
                    scores[i] = (1.0, float(rng.beta(*belief[i])))
        if policy.selection == "auto":
            for i, arm in enumerate(arms):
                if self._is_proven(arm, float(mean[i])):
                    # What held counts for its neighbours as well, and where one of them rates
                    # better by geometry its mean is larger. Yet only this one is known to hold,
                    # until something fails in this episode: then it may be the one to leave.
                    held = is_first and self._has_held(arm)
                    scores[i] = (3.0 if held else 2.0, float(mean[i]))
        return scores

    def _told_apart(self, arms: Sequence[Arm]) -> bool:
        """Tell whether causes leave more of the quality of some arms than of others."""
        left = [arm.hidden for arm in arms]
        return max(left) - min(left) > self.policy.telling

    def _has_held(self, arm: Arm) -> bool:
        return arm.own_successes >= self.policy.proven_weight

    def _is_proven(self, arm: Arm, mean: float) -> bool:
        policy = self.policy
        total = arm.successes + arm.failures
        return (
            arm.successes >= policy.proven_weight
            and arm.successes >= policy.proven_share * total
            and mean >= policy.proven_mean
        )

    def _explain(
        self, arm: Arm, own: NDArray[np.float64], score: tuple[float, float]
    ) -> dict[str, Any]:
        policy, share = self.policy, self._share(arm)
        quality = arm.quality
        left = 0.0 if quality is None else quality * arm.hidden
        prior = [0.0, 0.0] if quality is None else [left, 1 - left]
        return {
            "quality": quality,
            "hidden": round(arm.hidden, 6),
            "prior": [round(policy.floor + policy.kappa * part, 6) for part in prior],
            "graph": [round(share * arm.successes, 6), round(share * arm.failures, 6)],
            "episode": [round(float(v), 6) for v in own],
            "selected_by": ("mean", "sample", "proven", "proven")[int(score[0])],
            "score": round(score[1], 6),
        }


def choose(
    arms: Sequence[Arm],
    seed: int = 0,
    policy: Policy | None = None,
    trials: Sequence[Trial] = (),
    size_m: float = 0.1,
) -> Choice | None:
    """Return the arm to try now, or None when no arm is worth trying.

    >>> choose([Arm((0.0, 0.0, 0.02), 0.0, quality=0.8)]).index
    0
    >>> choose([]) is None
    True
    """
    ranked = BetaThompson(policy, size_m).rank(arms, trials, seed)
    return ranked[0] if ranked else None


def _geometry(arm: Arm) -> tuple[float, ...]:
    """Return what tells an arm from others whatever the order or name under which it comes."""
    quality = -1.0 if arm.quality is None else arm.quality
    numbers = [*arm.position, arm.theta, arm.opening, quality, arm.successes, arm.failures]
    numbers += [v for axis in arm.axes or () for v in axis]
    return tuple(round(v, 7) for v in numbers)


def _interval90(belief: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the central 90 % interval of each Beta belief, (n, 2)."""
    from scipy.special import betaincinv

    tails = np.array([0.05, 0.95])
    return np.asarray(betaincinv(belief[:, :1], belief[:, 1:], tails[None, :]))
