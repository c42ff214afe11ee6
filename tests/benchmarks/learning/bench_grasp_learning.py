"""Time of a decision, time to act while learning, and transfer between robots.

    python tests/benchmarks/learning/bench_grasp_learning.py [decision] [latency] [transfer]

``decision``: the bandit over 50 candidates with priors ready, beside a random forest of
scikit-learn that is refitted from 500 outcomes and rates the same candidates, as a learner
without own trees would do. ``latency``: how long the real-time TEXPLORE takes to act while its
model trains on 5,000 experiences, against one period and 5 ms. ``transfer``: first tries of a robot
that starts from another's outcomes, beside one that does not. The learners side by side are ``rtask
learn benchmark``.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable

import numpy as np

from grasp.learning.bandit import Arm, BetaThompson, Trial


def decision(rounds: int = 40) -> None:
    """Print the time of both sides, interleaved."""
    from sklearn.ensemble import RandomForestClassifier

    rng = np.random.default_rng(0)
    learner = BetaThompson(size_m=0.08)
    trials = [Trial((0.0, 0.01 * k, 0.03), 0.3 * k, False) for k in range(3)]
    features, held = rng.normal(size=(500, 8)), rng.random(500) < 0.5
    ours, peer, busy = [], [], []
    for _ in range(rounds):
        arms = [
            Arm((*rng.normal(0, 0.02, 2), 0.03), rng.uniform(0, np.pi), rng.uniform(0.2, 0.9),
                float(rng.integers(4)), float(rng.integers(4)))
            for _ in range(50)
        ]  # fmt: skip
        started, worked = time.perf_counter(), time.thread_time()
        learner.rank(arms, trials, seed=1)
        ours.append(1e3 * (time.perf_counter() - started))
        busy.append(1e3 * (time.thread_time() - worked))
        started = time.perf_counter()
        forest = RandomForestClassifier(n_estimators=100, random_state=0).fit(features, held)
        forest.predict_proba(rng.normal(size=(50, 8)))
        peer.append(1e3 * (time.perf_counter() - started))
    print(
        f"decision, 50 candidates: ours {np.median(ours):.2f} ms, 95 % within "
        f"{np.quantile(ours, 0.95):.2f} ms (target 5), of the processor {np.median(busy):.2f} ms; "
        f"forest refitted {np.median(peer):.0f} ms, "
        f"ratio {np.median(peer) / np.median(ours):.0f}"
    )


def latency(experiences: int = 5000, actions: int = 400, rate_hz: float = 25.0) -> None:
    """Print how long an action takes while the model trains."""
    from grasp.learning.agents.texplore import RealTimeTexplore
    from grasp.learning.environments import TwoRooms
    from grasp.learning.transition import Transition

    world = TwoRooms()
    state, _ = world.reset(seed=0)
    steps = []
    rng = np.random.default_rng(0)
    for _ in range(experiences):
        action = int(rng.integers(4))
        after, reward, ended, _, _ = world.step(action)
        steps.append(Transition(state, action, reward, after, ended))
        state = world.reset()[0] if ended else after
    with RealTimeTexplore(world.bins(), 4, seed=0, rate_hz=rate_hz) as agent:
        agent.learn_examples(steps[:50])
        agent.wait_until_learned(60)
        agent.act(state)
        agent.learn_examples(steps)
        took, busy = [], []
        for _ in range(actions):
            started = time.perf_counter()
            action = agent.act(state)
            took.append(time.perf_counter() - started)
            busy.append(agent.is_learning)
            after, reward, ended, _, _ = world.step(action)
            agent.observe(Transition(state, action, reward, after, ended))
            state = world.reset()[0] if ended else after
    limit = agent.period_s + 0.005
    print(
        f"latency at {rate_hz:.0f} Hz: {np.mean(np.array(took) <= limit):.1%} of {actions} actions "
        f"within {1e3 * limit:.0f} ms (target 99 %), worst {1e3 * max(took):.1f} ms; "
        f"learning during {np.mean(busy):.0%} of them"
    )


def transfer(seeds: int = 20) -> None:
    """Print first tries of both robots."""
    from grasp.learning import comparison
    from grasp.learning.metrics import bootstrap, difference, first_try

    shared, alone = comparison.transfer(seeds)
    print(
        f"transfer, {seeds} lives: first tries that held {bootstrap(shared, first_try)} from "
        f"another's outcomes, {bootstrap(alone, first_try)} alone, "
        f"{difference(shared, alone, first_try)} more"
    )


def main() -> None:
    """Run what is asked for, else everything."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parts: dict[str, Callable[[], None]] = {
        "decision": decision,
        "latency": latency,
        "transfer": transfer,
    }
    parser.add_argument("what", nargs="*", help=f"of {', '.join(parts)}")
    for name in parser.parse_args().what or parts:
        parts[name]()


if __name__ == "__main__":
    main()
