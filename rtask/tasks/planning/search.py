"""Forward search, goal by goal, guided by the costs of a relaxed problem without deletions.

Goals are reached one after another, each by weighted A* over the steps that can matter to it, and
no goal reached before may be lost at the end. Where that order ends in a dead end, all open goals
are searched together (Hoffmann and Nebel 2001, "The FF planning system", 5, does both likewise).
"""

from __future__ import annotations

import heapq
import itertools
from collections import defaultdict
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

from rtask.errors import SearchLimit
from rtask.tasks.planning.grounding import ground
from rtask.tasks.planning.problem import Atom, Problem, Step

__all__ = ["Plan", "find_plan", "goal_costs"]


@dataclass(frozen=True)
class Plan:
    """Steps that reach the goal, in order."""

    steps: tuple[Step, ...]
    cost_s: float


@dataclass(frozen=True)
class _Operator:
    """A step over numbered facts; sets of facts are the bits of an integer."""

    step: Step
    needs: int
    adds: int
    deletes: int
    need_list: tuple[int, ...]
    add_list: tuple[int, ...]
    cost: float
    workers: tuple[str, ...] = ()


_BUSY = 0.1
"""What a step of a busier worker costs more, per second that it has more to do than the idlest."""
_Alternatives = tuple[int, ...]
"""Numbers of facts of which any is to hold."""


def _mask(facts: Iterable[int]) -> int:
    return sum(1 << fact for fact in set(facts))


def _holds(state: int, goal: _Alternatives) -> bool:
    return any(state >> fact & 1 for fact in goal)


class _Numbering(dict[Atom, int]):
    """Facts by number, in the order of their first use."""

    def __missing__(self, atom: Atom) -> int:
        self[atom] = number = len(self)
        return number

    def mask(self, atoms: Iterable[Atom]) -> int:
        bits = 0
        for atom in atoms:
            bits |= 1 << self[atom]
        return bits


def find_plan(
    problem: Problem,
    *,
    max_states: int = 200_000,
    require_time: Callable[[], None] = lambda: None,
) -> Plan | None:
    """Return a plan, or None if none exists.

    Parameters
    ----------
    require_time
        Called at each state; raises once the time is up.

    Raises
    ------
    SearchLimit
        More than ``max_states`` states were looked at.
    """
    return _Search(problem, max_states, require_time).run()


def goal_costs(problem: Problem) -> list[float | None]:
    """Return the cost of each goal by itself if no step undid anything; None if out of reach."""
    search = _Search(problem, 0, lambda: None)
    return search.costs()


class _Search:
    """One search: its operators, and how many states it may still look at."""

    def __init__(self, problem: Problem, max_states: int, require_time: Callable[[], None]) -> None:
        self.left, self.require_time = max_states, require_time
        self.failure_cost_s = problem.failure_cost_s
        # How long each worker is busy with the goals planned so far, s.
        self.loads = dict.fromkeys(sorted(problem.workers), 0.0)
        fluents, self.numbers = problem.fluents, _Numbering()
        self.goals = [
            tuple(self.numbers[atom] for atom in dict.fromkeys(goal))
            for goal in dict.fromkeys(problem.goals)
        ]
        self.start = self.numbers.mask(
            fact for fact in problem.facts if fact[0] in fluents or fact in self.numbers
        )
        self.achievers: dict[int, list[_Operator]] = defaultdict(list)
        self.operators = []
        for step in ground(problem):
            operator = self._operator(step, fluents, problem.failure_cost_s)
            self.operators.append(operator)
            for fact in operator.add_list:
                self.achievers[fact].append(operator)

    def run(self) -> Plan | None:
        """Return a plan for all goals."""
        state, steps, reached = self.start, list[_Operator](), list[_Alternatives]()
        for goal in self._agenda():
            reached.append(goal)
            chosen = self._shared_out(self._relevant(state, (goal,)))
            operators = self._reach(state, reached, (goal,), chosen)
            if operators is None:
                return self._together()
            for operator in operators:
                state = state & ~operator.deletes | operator.adds
                for worker in operator.workers:
                    self.loads[worker] += operator.step.duration_s
            steps += operators
        return self._plan(steps)

    def _shared_out(self, operators: Sequence[_Operator]) -> Sequence[_Operator]:
        """Return steps of which those of busy workers cost more.

        All goals in the hands of one of two robots cost no more than half of them in each, and
        take twice as long.
        """
        idlest = min(self.loads.values(), default=0.0)
        return [
            replace(operator, cost=operator.cost + _BUSY * (busy - idlest))
            if (busy := max((self.loads[name] for name in operator.workers), default=0.0)) > idlest
            else operator
            for operator in operators
        ]  # fmt: skip

    def costs(self) -> list[float | None]:
        """Return what each goal costs by itself if nothing were ever deleted; None if no way."""
        relaxed = _Relaxed(self.operators)
        return [relaxed.cost(self.start, (goal,)) for goal in self.goals]

    def _agenda(self) -> list[_Alternatives]:
        """Return the goals, those that hold already first so that they are kept."""
        return sorted(self.goals, key=lambda goal: not _holds(self.start, goal))

    def _together(self) -> Plan | None:
        operators = self._reach(self.start, self.goals, tuple(self.goals), self.operators)
        return None if operators is None else self._plan(operators)

    def _plan(self, operators: Sequence[_Operator]) -> Plan:
        steps = tuple(operator.step for operator in operators)
        return Plan(steps, sum(step.cost_s(self.failure_cost_s) for step in steps))

    def _operator(self, step: Step, fluents: frozenset[str], failure_cost_s: float) -> _Operator:
        needs = tuple(self.numbers[atom] for atom in step.preconditions if atom[0] in fluents)
        adds = tuple(self.numbers[atom] for atom in step.adds)
        added = self.numbers.mask(step.adds)
        return _Operator(
            step, _mask(needs), added,
            self.numbers.mask(step.deletes) & ~added, tuple(set(needs)), adds,
            step.cost_s(failure_cost_s),
            tuple(value for _, value in step.arguments if value in self.loads),
        )  # fmt: skip

    def _relevant(self, state: int, goals: Sequence[_Alternatives]) -> list[_Operator]:
        """Return the steps that can matter to goals, by regression through facts not held."""
        pending = [fact for goal in goals if not _holds(state, goal) for fact in goal]
        seen, chosen = set(pending), dict[int, _Operator]()
        while pending:
            for operator in self.achievers[pending.pop()]:
                if id(operator) in chosen:
                    continue
                chosen[id(operator)] = operator
                # What holds is not regressed: if it must be restored on the way, this search
                # ends without a path, and that of all goals together takes over.
                for fact in operator.need_list:
                    if fact not in seen and not state >> fact & 1:
                        seen.add(fact)
                        pending.append(fact)
        return list(chosen.values())

    def _reach(
        self, start: int, goals: Sequence[_Alternatives], open_goals: Sequence[_Alternatives],
        operators: Sequence[_Operator],
    ) -> list[_Operator] | None:  # fmt: skip
        """Return steps after which all goals hold, guided by the open ones, or None."""
        masks = [_mask(goal) for goal in goals]
        if all(start & mask for mask in masks):
            return []
        relaxed = _Relaxed(operators)
        first = relaxed.cost(start, open_goals)
        if first is None:
            return None
        counter = itertools.count()
        queue = [(first, next(counter), start)]
        costs: dict[int, float] = {start: 0.0}
        parents: dict[int, tuple[int, _Operator]] = {}
        while queue:
            _, _, state = heapq.heappop(queue)
            if all(state & mask for mask in masks):
                return _path(parents, state, start)
            self.left -= 1
            if self.left < 0:
                raise SearchLimit("the search looked at as many states as it may")
            self.require_time()
            for operator in operators:
                if state & operator.needs != operator.needs:
                    continue
                after = state & ~operator.deletes | operator.adds
                cost = costs[state] + operator.cost
                if cost >= costs.get(after, float("inf")):
                    continue
                estimate = relaxed.cost(after, open_goals)
                if estimate is None:
                    continue
                costs[after], parents[after] = cost, (state, operator)
                heapq.heappush(queue, (cost + estimate, next(counter), after))
        return None


class _Relaxed:
    """Costs of goals if nothing were ever deleted, a sum over preconditions (h_add)."""

    def __init__(self, operators: Sequence[_Operator]) -> None:
        self._operators = operators
        self._users: dict[int, list[int]] = defaultdict(list)
        for number, operator in enumerate(operators):
            for fact in operator.need_list:
                self._users[fact].append(number)

    def cost(self, state: int, goals: Sequence[_Alternatives]) -> float | None:
        """Return the cost of the goals from a state, or None if they are out of reach."""
        missing = [len(operator.need_list) for operator in self._operators]
        sums = [operator.cost for operator in self._operators]
        costs: dict[int, float] = {}
        queue = [(0.0, fact) for fact in self._users if state >> fact & 1]
        queue += [(0.0, fact) for goal in goals for fact in goal if state >> fact & 1]
        for operator in self._operators:
            if not operator.need_list:
                queue += [(operator.cost, fact) for fact in operator.add_list]
        heapq.heapify(queue)
        open_goals = dict.fromkeys(goals)
        total = 0.0
        while queue and open_goals:
            cost, fact = heapq.heappop(queue)
            if fact in costs:
                continue
            costs[fact] = cost
            # Facts come in the order of their costs: the first alternative is the cheapest.
            for goal in [goal for goal in open_goals if fact in goal]:
                del open_goals[goal]
                total += cost
            for number in self._users.get(fact, ()):
                missing[number] -= 1
                sums[number] += cost
                if not missing[number]:
                    for added in self._operators[number].add_list:
                        if added not in costs:
                            heapq.heappush(queue, (sums[number], added))
        return None if open_goals else total


def _path(parents: Mapping[int, tuple[int, _Operator]], state: int, start: int) -> list[_Operator]:
    steps = []
    while state != start:
        state, operator = parents[state]
        steps.append(operator)
    return steps[::-1]
