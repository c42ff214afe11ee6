"""Goals that one can try in a graph, from the names of what stands where in it."""

from __future__ import annotations

import re
from collections.abc import Iterator

from rtask.errors import RtaskError
from rtask.rdf.namespaces import PREFIXES
from rtask.tasks.actions import Select
from rtask.tasks.language.reader import read_goal

__all__ = ["example_goals"]

_MOST = 500
_NUMBER = re.compile(r"[-_ ]*\d+$")
_LOCATED = f"""{PREFIXES}
SELECT DISTINCT ?name ?place WHERE {{
  ?thing rt:exemplarOf/rt:name ?name ; rt:locatedOn ?where .
  ?where rt:name ?place
  FILTER NOT EXISTS {{ ?robot rt:hasEndEffector ?where }}
}} ORDER BY ?name ?place LIMIT {_MOST}"""


def example_goals(select: Select, base: str = "") -> list[str]:
    """Return goals in words about things and places of this graph, none where it has no two places.

    Each of them is read before it is offered, so that none fails for its words; whether robots can
    reach it is for the planner to say.

    Parameters
    ----------
    select
        Evaluates the look-ups.
    base
        What ``kb:`` stands for.
    """
    rows = select(_LOCATED)
    located = [(str(row.value("name")), str(row.value("place"))) for row in rows]
    goals = dict.fromkeys(_sentences(located))
    return [goal for goal in goals if _is_readable(select, goal, base)]


def _sentences(located: list[tuple[str, str]]) -> Iterator[str]:
    places = sorted({place for _, place in located})
    if len(places) < 2:
        return
    name, place = located[0]
    target = next(other for other in places if other != place)
    yield f"every {_NUMBER.sub('', name)} to the {target}"
    yield f"{name} to the {target}"
    yield f"everything from the {place} to the {target}"


def _is_readable(select: Select, goal: str, base: str) -> bool:
    try:
        return bool(read_goal(select, goal, base).aims)
    except RtaskError:
        return False
