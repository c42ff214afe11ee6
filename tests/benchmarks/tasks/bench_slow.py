"""What it would be worth that idle robots take over what slow ones have not begun.

    python -m tests.benchmarks.tasks.bench_slow [-n LABS] [--seed SEED]

carries out the plans of the labs of :mod:`tests.benchmarks.tasks.bench_idle` twice: each robot does
its own steps, as claims are today; and a robot with nothing to do takes over picking a thing up and
putting it down, where by planned times it would have put it down sooner than the other robot. One
robot of each lab takes a multiple of the planned times. Nobody knows of that but by what has ended.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np

from rtask.tasks.plan import PlannedStep
from tests.benchmarks.tasks.bench_idle import plan_of, put_of

_MAX_SLOWNESS = 4.0
_RESAMPLES = 2000


def main() -> None:
    """Print both ways of all labs, and the ratio of their times with its interval."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("-n", type=int, default=40, help="labs")
    parser.add_argument("--seed", type=int, default=1)
    given = parser.parse_args()
    pairs = []
    for number in range(given.n):
        rng = np.random.default_rng([given.seed, number])
        steps, reach = plan_of(rng)
        slow = {str(rng.choice(sorted(reach))): float(rng.uniform(1.0, _MAX_SLOWNESS))}
        runs = [Carrying(steps, reach, slow, takes).run() for takes in (False, True)]
        pairs.append(runs)
        print(number, *(f"{run.now:.0f} s, {run.beside_work:.0f} s idle beside work, "
                        f"{run.taken} taken;" for run in runs), flush=True)  # fmt: skip
    ends = np.array([[run.now for run in runs] for runs in pairs])
    rng = np.random.default_rng(given.seed)
    picks = rng.integers(len(ends), size=(_RESAMPLES, len(ends)))
    ratios = ends[picks, 1].sum(axis=1) / ends[picks, 0].sum(axis=1)
    low, high = np.quantile(ratios, [0.025, 0.975])
    total = ends.sum(axis=0)
    print(f"until a goal is reached: {total[0] / len(ends):.0f} s and {total[1] / len(ends):.0f} s")
    print(f"ratio {total[1] / total[0]:.2f} ({low:.2f} to {high:.2f})")
    print(
        f"sooner in {(ends[:, 1] < ends[:, 0]).sum()}, later in {(ends[:, 1] > ends[:, 0]).sum()}"
    )
    for way, name in enumerate(("own steps", "taking over")):
        all_s = sum(runs[way].now * len(runs[way].reach) for runs in pairs)
        beside = sum(runs[way].beside_work for runs in pairs) / all_s
        print(f"{name}: idle beside work {beside:.3f} of the time of all robots")


@dataclass
class Carrying:
    """A plan while it is carried out."""

    steps: Sequence[PlannedStep]
    reach: dict[str, set[str]]
    slow: dict[str, float]
    takes_over: bool
    now: float = 0.0
    beside_work: float = 0.0
    taken: int = 0
    done: set[int] = field(default_factory=set)
    busy: dict[str, tuple[PlannedStep, float, float]] = field(default_factory=dict)
    """Step of each robot at work, when it ends, and when it was planned to."""
    holds: dict[str, str] = field(default_factory=dict)
    who: dict[int, tuple[str, ...]] = field(default_factory=dict)
    after: dict[int, set[int]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.who = {step.number: step.robots for step in self.steps}
        self.after = {step.number: set(step.after) for step in self.steps}

    def run(self) -> Carrying:
        """Carry out all steps."""
        while len(self.done) < len(self.steps):
            for robot in sorted(self.reach):
                if robot not in self.busy:
                    self._begin(robot)
            idle = [r for r in self.reach if r not in self.busy and r not in self.holds]
            assert self.busy, "the plan is stuck"
            end = min(end for _, end, _ in self.busy.values())
            waiting = sum(any(True for _ in self._candidates(robot)) for robot in idle)
            self.beside_work += waiting * (end - self.now)
            self.now = end
            for robot, (step, ends, _) in list(self.busy.items()):
                if ends <= end:
                    self._end(robot, step)
        return self

    def _begin(self, robot: str) -> None:
        step = next((step for step in self._open() if self._may(robot, step)), None)
        if step is None and self.takes_over and robot not in self.holds:
            step = self._take_over(robot)
        if step is not None:
            took = step.duration_s * self.slow.get(robot, 1.0)
            self.busy[robot] = step, self.now + took, self.now + step.duration_s

    def _end(self, robot: str, step: PlannedStep) -> None:
        del self.busy[robot]
        self.done.add(step.number)
        if put_of(step, self.steps) is not None:
            self.holds[robot] = step.arguments["thing"]
        else:
            self.holds.pop(robot, None)

    def _open(self) -> Iterator[PlannedStep]:
        begun = {step.number for step, _, _ in self.busy.values()} | self.done
        return (step for step in self.steps if step.number not in begun)

    def _may(self, robot: str, step: PlannedStep) -> bool:
        held = self.holds.get(robot)
        return (
            robot in self.who[step.number] and self.after[step.number] <= self.done
            and held in (None, step.arguments["thing"])
        )  # fmt: skip

    def _candidates(self, robot: str) -> Iterator[tuple[PlannedStep, PlannedStep]]:
        """Yield what a robot could pick up now and put down in place of another one."""
        for pick in self._open():
            put = put_of(pick, self.steps)
            owners = self.who[pick.number]
            if put is None or robot in owners or self.who[put.number] != owners:
                continue
            places = {pick.arguments["place"], put.arguments["place"]}
            if self._needs(pick) <= self.done and places <= self.reach[robot]:
                yield pick, put

    def _needs(self, pick: PlannedStep) -> set[int]:
        """Return what a step waits for apart from other work of its robot with other things."""
        thing, owners = pick.arguments["thing"], self.who[pick.number]
        own = {step.number for step in self.steps
               if self.who[step.number] == owners and step.arguments["thing"] != thing}  # fmt: skip
        return self.after[pick.number] - own

    def _take_over(self, robot: str) -> PlannedStep | None:
        best = None
        for pick, put in self._candidates(robot):
            gain = self._expected(pick, put) - (self.now + pick.duration_s + put.duration_s)
            if gain > 0 and (best is None or gain > best[0]):
                best = gain, pick, put
        if best is None:
            return None
        _, pick, put = best
        owners = self.who[pick.number]
        self.after[pick.number] = self._needs(pick)
        for step in self.steps:
            if self.who[step.number] == owners and step.number not in (pick.number, put.number):
                other = step.arguments["thing"] != pick.arguments["thing"]
                self.after[step.number] -= {pick.number, put.number} if other else set()
        self.who[pick.number] = self.who[put.number] = (robot,)
        self.taken += 1
        return pick

    def _expected(self, pick: PlannedStep, put: PlannedStep) -> float:
        """Return when a robot is expected to have put down what it has not begun with."""
        (owner,) = self.who[pick.number]
        at = self.now
        if owner in self.busy:
            # What should have ended by now may end any moment.
            at = max(at, self.busy[owner][2])
        mine = [s for s in self._open() if owner in self.who[s.number] and s.number <= put.number]
        return at + sum(step.duration_s for step in mine)


if __name__ == "__main__":
    main()
