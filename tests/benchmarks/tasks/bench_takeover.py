"""What it is worth that idle robots take over what others have not begun, with the real executors.

    python -m tests.benchmarks.tasks.bench_takeover [-n LABS] [--seed SEED]

Labs as those of :mod:`tests.benchmarks.tasks.bench_idle`, one robot of each slower than planned by
a factor of up to four, things that slip, and in each one event: none, a program that is killed in
the midst of a step and started again later, one that is only started later, an arm that fails for
good, a thing that a person moves. Each robot is an :class:`simulate.tasks.executor.Executor` that
claims from an engine, as users have it; what takes time is the body, by a clock of the benchmark.
Each lab is carried out twice, with and without taking over.

The rule, fixed before the seeds that count were run: taking over stays if the time until goals are
reached is shorter (95 % interval of the ratio below 1, of labs whose goal is reached both ways),
for no event longer by more than chance (interval above 1), robots are less often idle beside work,
no fewer goals are reached, and no order that a goal asks for is broken and nothing is done twice.
"""

from __future__ import annotations

import argparse
import datetime as dt
import heapq
import threading
import zlib
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

import rtask
from rtask.engine import Engine
from rtask.engine.operations.tasks import queue as operations
from rtask.rdf.namespaces import PREFIXES
from rtask.tasks import storing
from rtask.tasks.actions import ActionClass, read_actions
from rtask.tasks.queue import claiming
from rtask.tasks.queue.pairs import open_pairs
from rtask.tasks.queue.reading import read_queue
from simulate.study.tasks.trial import KilledError, stored_picks
from simulate.tasks.body import Deed
from simulate.tasks.crew import Crew
from simulate.tasks.executor import Executor, Turn
from simulate.tasks.lab import LabRobot, read_lab
from tests.benchmarks.tasks.bench_idle import _BASE, _PLACES, _place, _update

EVENTS = ("", "killed", "late", "dead_arm", "moved")
_GOALS = (
    "every cup into the left box; every pen into the right box",
    "every cup into the left box, then every pen into the right box",
)
_MAX_SLOWNESS = 4.0
_SLIP = 0.05
_POLL_S = 2.0
_CAP_S = 1800.0
_AWAY_S = (30.0, 240.0)
_RESAMPLES = 2000
_PLANNED_S = {"pick": 10.0, "put": 6.0}


class Clock:
    """Time that passes only while all robots act or wait; one of their threads runs at a time."""

    def __init__(self) -> None:
        self.begun = dt.datetime.now(dt.UTC)
        self.now_s = 0.0
        self._waiting: list[tuple[float, int, threading.Event]] = []
        self._count = 0

    def now(self, tz: dt.tzinfo | None = None) -> dt.datetime:
        return self.begun + dt.timedelta(seconds=self.now_s)

    def enter(self, work: Callable[[], None]) -> threading.Thread:
        """Start a thread whose turn comes with the others that wait."""
        mine = self._queued(0.0)

        def run() -> None:
            mine.wait()
            try:
                work()
            finally:
                self.pass_on()

        thread = threading.Thread(target=run, daemon=True)
        thread.start()
        return thread

    def sleep(self, seconds: float) -> None:
        mine = self._queued(seconds)
        self.pass_on()
        mine.wait()

    def pass_on(self) -> None:
        """Let the one go on that waits for the earliest time."""
        if self._waiting:
            self.now_s, _, other = heapq.heappop(self._waiting)
            other.set()

    def _queued(self, seconds: float) -> threading.Event:
        mine = threading.Event()
        self._count += 1
        heapq.heappush(self._waiting, (self.now_s + seconds, self._count, mine))
        return mine


class _Dates:
    """The module ``datetime`` by a clock of the benchmark."""

    def __init__(self, clock: Clock) -> None:
        class Moment(dt.datetime):
            @classmethod
            def now(cls, tz: dt.tzinfo | None = None) -> dt.datetime:  # type: ignore[override]
                return clock.now(tz)

        self.datetime = Moment

    def __getattr__(self, name: str) -> Any:
        return getattr(dt, name)


@contextmanager
def _by(clock: Clock, takes_over: bool) -> Iterator[None]:
    """Let the product go by a clock, with or without taking over."""
    modules = (claiming, storing, operations)
    find: Any = claiming.find_takeover  # type: ignore[attr-defined]
    for module in modules:
        module.dt = _Dates(clock)  # type: ignore[attr-defined]
    if not takes_over:
        claiming.find_takeover = lambda *arguments: None  # type: ignore[attr-defined]
    try:
        yield
    finally:
        claiming.find_takeover = find  # type: ignore[attr-defined]
        for module in modules:
            module.dt = dt  # type: ignore[attr-defined]


@dataclass(frozen=True)
class TimedRobot(LabRobot):
    """A robot of a lab whose actions take time."""

    clock: Clock
    slowness: float
    seed: int

    def pick(self, item: str, place: str, hand: str) -> Deed:
        took = self._wait("pick", item)
        return replace(super().pick(item, place, hand), duration_s=took)

    def put(self, item: str, place: str, hand: str) -> Deed:
        took = self._wait("put", item)
        return replace(super().put(item, place, hand), duration_s=took)

    def _wait(self, action: str, item: str) -> float:
        # Drawn for robot and thing, so that both ways meet the same.
        rng = np.random.default_rng([self.seed, zlib.crc32(f"{self.iri} {action} {item}".encode())])
        took = _PLANNED_S[action] * self.slowness * float(rng.lognormal(0.0, 0.2))
        self.clock.sleep(took)
        return took


@dataclass
class Run:
    """One lab, carried out once."""

    number: int
    seed: int
    takes_over: bool
    event: str
    clock: Clock = field(default_factory=Clock)
    end_s: float = _CAP_S
    is_reached: bool = False
    is_over: bool = False
    beside_s: float = 0.0
    robots: int = 0
    taken: int = 0
    repairs: int = 0
    broken: int = 0
    twice: int = 0
    last: dict[str, Turn] = field(default_factory=dict)
    executors: dict[str, Executor] = field(default_factory=dict)
    actions: Mapping[str, ActionClass] = field(default_factory=dict)

    def carry_out(self) -> Run:
        """Carry the goal out until it is reached, given up, or the time is over."""
        rng = np.random.default_rng([self.seed, self.number])
        names = [f"robot-{number}" for number in range(int(rng.integers(2, 5)))]
        reach = {name: [p for p in _PLACES if rng.random() < 0.8] or [_PLACES[0]] for name in names}
        reach[names[0]] = list(_PLACES)
        with rtask.open(":memory:", base=_BASE) as kb, Engine(kb) as engine:
            kb.update(_update(rng, reach))
            self.engine, self.planner = engine, rtask.connect(engine)
            self.lab = read_lab(self.planner.query, np.random.default_rng([self.seed, 1]), _SLIP)
            self.actions = {a.iri: a for a in read_actions(kb.select, kb.catalogue.is_ontology)}
            self.robots = len(names)
            self.goals = {item: _place("left box" if "/cup-" in item else "right box")
                          for item in self.lab.where}  # fmt: skip
            self.has_order = self.number % 3 == 2
            slow = str(rng.choice(sorted(self.lab.hands)))
            factor = float(rng.uniform(1.0, _MAX_SLOWNESS))
            self.struck = str(rng.choice(sorted(self.lab.hands)))
            self.at, self.away_s = int(rng.integers(1, 4)), float(rng.uniform(*_AWAY_S))
            self._inject()
            with _by(self.clock, self.takes_over):
                self.planner.call("store_plan", goal=_GOALS[self.has_order])
                threads = [
                    self.clock.enter(lambda r=robot: self._robot(r, factor if r == slow else 1.0))
                    for robot in sorted(self.lab.hands)
                ]  # fmt: skip
                threads.append(self.clock.enter(self._plan))
                self.clock.pass_on()
                for thread in threads:
                    thread.join()
                plans = read_queue(kb)
            self.taken = sum(bool(s.taken_from) for p in plans for s in p.steps) // 2
            self.twice = max(stored_picks(kb) - [d[1] for d in self.lab.done].count("pick"), 0)
        return self

    def _robot(self, robot: str, slowness: float) -> None:
        body = TimedRobot(self.lab, robot, self.clock, slowness, self.seed)
        if self.event == "late" and robot == self.struck:
            self.clock.sleep(self.away_s)
        while not self.is_over:
            client = rtask.connect(self.engine, agent=robot.rpartition("/")[2])
            self.executors[robot] = Executor(client, body)
            try:
                self._work(robot)
            except KilledError:
                self.last[robot] = Turn("idle")
                self.clock.sleep(self.away_s)

    def _work(self, robot: str) -> None:
        while not self.is_over:
            self.last.pop(robot, None)
            turn = self.executors[robot].turn()
            self.last[robot] = turn
            if turn.result == "failed" and robot in self.lab.dead:
                # A person sees that the arm is dead, and says so.
                self.engine.kb.update(f"{PREFIXES} INSERT DATA {{ <{robot}> a rt:OutOfOrder }}")
            if turn.result == "idle" and not self.is_over:
                if self._could_work(robot):
                    self.beside_s += _POLL_S
                self.clock.sleep(_POLL_S)

    def _could_work(self, robot: str) -> bool:
        """Whether a robot that waits could bring a thing that nobody has begun with."""
        if robot in self.lab.dead:
            return False
        pairs = open_pairs(read_queue(self.engine.kb), robot, self.clock.now(), self.actions)
        return any(
            {pair.pick.arguments["place"], pair.put.arguments["place"]} <= self.lab.reach[robot]
            for pair in pairs
        )

    def _plan(self) -> None:
        """Plan again what fails, once all robots have nothing to do."""
        crew = Crew(self.planner, self.executors)
        while not self.is_over:
            self.clock.sleep(_POLL_S)
            if self.clock.now_s >= _CAP_S or crew.ended:
                self.is_over = True
            elif len(self.last) == self.robots and all(
                turn.result == "idle" for turn in self.last.values()
            ):
                crew._settle({plan for turn in self.last.values() for plan in turn.stuck})
            self.repairs = sum(crew._repairs.values())

    def _inject(self) -> None:
        lab, count = self.lab, 0

        def before(robot: str, action: str, item: str) -> None:
            nonlocal count
            if robot != self.struck or self.event not in ("dead_arm", "moved") or action != "pick":
                return
            count += 1
            if count == self.at and self.event == "dead_arm":
                lab.dead.add(robot)
            elif count == self.at:
                lab.where[item] = _place("table" if "bench" in lab.where[item] else "bench")

        def after(robot: str, action: str, item: str) -> None:
            nonlocal count
            if action == "put":
                self._note_put(item)
            if self.event == "killed" and robot == self.struck:
                count += 1
                if count == self.at:
                    raise KilledError

        lab.on_deed, lab.on_done = before, after

    def _note_put(self, item: str) -> None:
        where, goals = self.lab.where, self.goals
        waits = [i for i in goals if "/cup-" in i and where.get(i) != goals[i]]
        if self.has_order and "/pen-" in item and where[item] == goals[item] and waits:
            self.broken += 1
        if all(where.get(thing) == place for thing, place in goals.items()):
            self.end_s, self.is_reached, self.is_over = self.clock.now_s, True, True


def main() -> None:
    """Print both ways of all labs, then what the rule looks at."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("-n", type=int, default=40, help="labs")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--first", type=int, default=0, help="number of the first lab")
    parser.add_argument("--without-events", action="store_true")
    given = parser.parse_args()
    pairs: list[tuple[Run, Run]] = []
    for number in range(given.first, given.first + given.n):
        event = "" if given.without_events else EVENTS[number % len(EVENTS)]
        runs = [Run(number, given.seed, takes, event).carry_out() for takes in (False, True)]
        pairs.append((runs[0], runs[1]))
        print(number, event or "none", *(
            f"{run.end_s:.0f} s, reached {run.is_reached}, beside work {run.beside_s:.0f} s, "
            f"{run.taken} taken, {run.repairs} repairs, broken {run.broken}, twice {run.twice};"
            for run in runs), flush=True)  # fmt: skip
        if len(pairs) % 10 == 0 or len(pairs) == given.n:
            _report(pairs, given.seed)


def _report(pairs: list[tuple[Run, Run]], seed: int) -> None:
    for event in (None, *EVENTS):
        chosen = [pair for pair in pairs if event is None or pair[0].event == event]
        both = [pair for pair in chosen if all(run.is_reached for run in pair)]
        if not both:
            continue
        ends = np.array([[run.end_s for run in pair] for pair in both])
        picks = np.random.default_rng(seed).integers(len(ends), size=(_RESAMPLES, len(ends)))
        sums = ends[picks].sum(axis=1)
        low, high = np.quantile(sums[:, 1] / sums[:, 0], [0.025, 0.975])
        total = ends.sum(axis=0)
        reached = [sum(pair[way].is_reached for pair in chosen) for way in (0, 1)]
        idle = [
            sum(pair[way].beside_s for pair in chosen)
            / sum(pair[way].end_s * pair[way].robots for pair in chosen)
            for way in (0, 1)
        ]
        print(
            f"{'all' if event is None else event or 'none'}: {len(chosen)} labs, "
            f"{total[0] / len(ends):.0f} s and {total[1] / len(ends):.0f} s, ratio "
            f"{total[1] / total[0]:.3f} ({low:.3f} to {high:.3f}); reached {reached[0]} and "
            f"{reached[1]}; idle beside work {idle[0]:.3f} and {idle[1]:.3f}; sooner in "
            f"{(ends[:, 1] < ends[:, 0]).sum()}, later in {(ends[:, 1] > ends[:, 0]).sum()}"
        )
    print(*(f"{name}: {sum(getattr(p[w], name) for p in pairs for w in (0, 1))};"
            for name in ("broken", "twice", "taken")), flush=True)  # fmt: skip


if __name__ == "__main__":
    main()
