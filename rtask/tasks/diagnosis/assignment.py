"""Why a planned step is its robot's, as things are now."""

from __future__ import annotations

from dataclasses import dataclass

from rtask.rdf.namespaces import PREFIXES
from rtask.rdf.terms import NamedNode
from rtask.tasks.actions import Select
from rtask.tasks.names import names_of

__all__ = ["Assignment", "read_assignment"]

_STEP = """
SELECT ?number ?text ?robot ?taken ?duration ?chance WHERE {
  ?plan a rt:TaskPlan ; rt:hasSubTask %(s)s .
  %(s)s rt:stepNumber ?number ; rt:parameterValues ?values ; rt:assignedTo ?robot .
  OPTIONAL { %(s)s rdfs:label ?text } OPTIONAL { %(s)s rt:assignmentReason ?taken }
  OPTIONAL { %(s)s rt:plannedDuration ?duration } OPTIONAL { %(s)s rt:plannedChance ?chance }
} ORDER BY ?robot"""
_CLAIM = """
SELECT ?why WHERE {
  ?claim rt:claims %(s)s ; prov:wasAssociatedWith ?robot ; prov:startedAtTime ?begun ;
    rt:claimReason ?why . %(s)s rt:assignedTo ?robot
} ORDER BY DESC(?begun) LIMIT 1"""


@dataclass(frozen=True)
class Assignment:
    """Who a planned step is assigned to, and why.

    Parameters
    ----------
    step
        The step in words.
    reason
        Why it is its robot's.
    is_planned
        Whether that is as the plan was made.
    """

    step: str
    reason: str
    is_planned: bool


def read_assignment(select: Select, subject: str) -> Assignment | None:
    """Return why a planned step is its robot's; None of anything else.

    The claim of the step says most, as it also tells why it was its turn; before that, what it was
    taken over for, or what the plan expects of it.
    """
    node = str(NamedNode(subject))
    rows = list(select(PREFIXES + _STEP % {"s": node}))
    if not rows:
        return None
    taken = str(rows[0].value("taken") or "")
    claims = [str(row.value("why")) for row in select(PREFIXES + _CLAIM % {"s": node})]
    robots = list(dict.fromkeys(str(row.value("robot")) for row in rows))
    names = names_of(select, robots)
    who = " and ".join(names[robot] for robot in robots)
    duration, chance = (float(str(rows[0].value(name) or 0.0)) for name in ("duration", "chance"))
    planned = f"expected to take {duration:.0f} s with a chance of {chance:.2f}"
    reason = f"it is {who}'s: {taken or 'the plan gives it to ' + who}; it is {planned}"
    return Assignment(
        str(rows[0].value("text") or subject), claims[0] if claims else reason, not taken
    )
