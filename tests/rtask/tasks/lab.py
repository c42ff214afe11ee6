"""A lab without a store: robots at places, boxes, and things to move."""

from __future__ import annotations

from rtask.tasks.planning.problem import Action, Atom, Estimate, Parameter, Problem


def fixed_estimate(duration_s: float, chance: float = 1.0) -> Estimate:
    """Return an estimate that is the same for all arguments."""
    return lambda arguments: (duration_s, chance)


PICK = Action(
    "pick",
    (Parameter("r", "robot"), Parameter("o", "thing"), Parameter("l", "place")),
    (("can_grasp", "r", "o"), ("reaches", "r", "l"), ("at", "o", "l"), ("free", "r")),
    (("holding", "r", "o"),), (("at", "o", "l"), ("free", "r")),
    fixed_estimate(8.0, 0.9),
)  # fmt: skip
PLACE = Action(
    "place",
    (Parameter("r", "robot"), Parameter("o", "thing"), Parameter("l", "place")),
    (("reaches", "r", "l"), ("holding", "r", "o")),
    (("at", "o", "l"), ("free", "r")), (("holding", "r", "o"),),
    fixed_estimate(4.0, 0.98),
)  # fmt: skip


def lab(things: int, robots: int) -> Problem:
    """Robots in a row: neighbours share a place; each thing is to move one robot's reach on."""
    names = tuple(f"robot{n}" for n in range(robots))
    places = tuple(f"place{n}" for n in range(robots + 1))
    objects = tuple(f"thing{n}" for n in range(things))
    facts: set[Atom] = {("free", name) for name in names}
    for number, name in enumerate(names):
        facts |= {("reaches", name, places[number]), ("reaches", name, places[number + 1])}
        facts |= {("can_grasp", name, thing) for thing in objects}
    goals = []
    for number, thing in enumerate(objects):
        start = number % (robots + 1)
        facts.add(("at", thing, places[start]))
        goals.append((("at", thing, places[(start + 2) % (robots + 1)]),))
    return Problem(
        {"robot": names, "place": places, "thing": objects},
        (PICK, PLACE), frozenset(facts), tuple(goals),
    )  # fmt: skip
