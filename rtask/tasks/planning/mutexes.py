"""Goals that cannot all hold at once, such as three cups in the two hands of a robot.

An object is *exclusive* in a place of a predicate if at most one of the facts that have it there is
ever true, as each step that makes one true needs and ends another: a hand is empty or holds one
thing. Such facts are a fact-alternating mutex group (Fišer and Komenda 2018, "Fact-alternating
mutex groups for classical planning"). A relaxed plan, which deletes nothing, sees none of this, and
a search would look at all that can be reached before it said so.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass

from rtask.tasks.planning.grounding import ground
from rtask.tasks.planning.problem import Atom, Goal, Problem, Step

__all__ = ["CrowdedGoal", "crowded_goals"]

_Position = tuple[str, int]
"""A predicate, and the place of an argument in it."""


@dataclass(frozen=True)
class CrowdedGoal:
    """A goal that finds no room beside the others.

    Parameters
    ----------
    takers
        The objects of which it needs one, each of which the other goals need, too.
    """

    goal: Goal
    takers: tuple[str, ...]


def crowded_goals(
    problem: Problem, require_time: Callable[[], None] = lambda: None
) -> tuple[CrowdedGoal, ...]:
    """Return goals without which the others may hold at once, as few as possible; mostly none.

    Parameters
    ----------
    require_time
        Called for each object that is looked at; raises once the time is up.
    """
    # Those that hold already come first, so that they are not the ones that find no room.
    goals = sorted(dict.fromkeys(problem.goals), key=problem.facts.isdisjoint)
    apart = _apart(goals)
    longest = max((len(atom) for goal in goals for atom in goal), default=0)
    steps: dict[str, list[Step]] | None = None
    crowded: dict[Goal, CrowdedGoal] = {}
    for place in range(1, longest):
        wanting = {
            goal: tuple(dict.fromkeys(atom[place] for atom in goal))
            for goal in apart
            if goal not in crowded and all(len(atom) > place for atom in goal)
        }
        # Most goals are about one thing each, which needs no look at the steps.
        if not _without_room(wanting):
            continue
        steps = _by_object(ground(problem)) if steps is None else steps
        exclusive = set()
        for taker, predicate in {(atom[place], atom[0]) for goal in wanting for atom in goal}:
            require_time()
            if _is_exclusive(taker, (predicate, place), steps.get(taker, ()), problem.facts):
                exclusive.add((taker, predicate))
        bound = {
            goal: takers for goal, takers in wanting.items()
            if all((atom[place], atom[0]) in exclusive for atom in goal)
        }  # fmt: skip
        for goal, tried in _without_room(bound).items():
            crowded[goal] = CrowdedGoal(goal, tried)
    return tuple(crowded.values())


def _apart(goals: Sequence[Goal]) -> list[Goal]:
    """Return the goals that share no fact with another: one fact may make two of them hold."""
    users: dict[Atom, int] = defaultdict(int)
    for goal in goals:
        for atom in set(goal):
            users[atom] += 1
    return [goal for goal in goals if all(users[atom] == 1 for atom in goal)]


def _without_room(wanting: Mapping[Goal, Sequence[str]]) -> dict[Goal, tuple[str, ...]]:
    """Return the goals that a largest matching leaves out, each with all that it could have had."""
    holder: dict[str, Goal] = {}

    def find(goal: Goal, tried: dict[str, None]) -> bool:
        """Give a goal one of what it wants, moving others on; Kuhn's algorithm."""
        for taker in wanting[goal]:
            if taker not in tried:
                tried[taker] = None
                if taker not in holder or find(holder[taker], tried):
                    holder[taker] = goal
                    return True
        return False

    left: dict[Goal, tuple[str, ...]] = {}
    for goal in wanting:
        tried: dict[str, None] = {}
        if not find(goal, tried):
            left[goal] = tuple(tried)
    return left


def _by_object(steps: Iterable[Step]) -> dict[str, list[Step]]:
    """Return the steps that make something true of each object."""
    of: dict[str, list[Step]] = defaultdict(list)
    for step in steps:
        for name in dict.fromkeys(value for atom in step.adds for value in atom[1:]):
            of[name].append(step)
    return of


def _is_exclusive(
    taker: str, position: _Position, steps: Sequence[Step], facts: frozenset[Atom]
) -> bool:
    """Tell whether at most one fact with an object in this position is ever true."""
    group = {position}

    def of_group(atoms: Iterable[Atom]) -> set[Atom]:
        return {
            atom for atom in atoms
            if any((atom[0], at) in group for at, value in enumerate(atom) if at and value == taker)
        }  # fmt: skip

    is_open = True
    while is_open:
        is_open = False
        for step in steps:
            needed, ended = set(step.preconditions), set(step.deletes) - set(step.adds)
            new = of_group(step.adds) - needed
            if len(new) <= len(of_group(ended & needed)):
                continue
            # What it ends may be the other side of the same coin: "empty" beside "holds".
            sides = {
                (atom[0], at)
                for atom in ended & needed
                for at, value in enumerate(atom)
                if at and value == taker and (atom[0], at) not in group
            }
            if not sides:
                return False
            group.add(min(sides))
            is_open = True
            break
    return len(of_group(facts)) <= 1
