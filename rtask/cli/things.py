"""Objects of the graph as people write them on the command line: by name or by IRI."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

from rtask.errors import UnknownTermError, UsageError, nearest

__all__ = ["Select", "find_object", "known_object"]

Select = Callable[[str], Sequence[Mapping[str, Any]]]
"""Answers a SPARQL query, as the clients and graphs do."""


def find_object(select: Select, name: str) -> str | None:
    """Return the IRI of the object that has a name, or whose IRI the name is.

    None stands for no such object.

    Raises
    ------
    UsageError
        When several objects have the name.
    """
    from rtask.rdf.terms import literal

    text = literal(name)
    rows = _objects(select, f"FILTER(?name = {text} || STR(?object) = {text})")
    found = sorted({str(row["object"]) for row in rows})
    if len(found) > 1:
        raise UsageError(
            f"{len(found)} objects are called {name!r}; give the IRI: {', '.join(found)}"
        )
    return found[0] if found else None


def known_object(select: Select, name: str) -> str:
    """Return the IRI of the object that a command is about.

    Parameters
    ----------
    name
        Its name, or an IRI; one that is not in the graph is returned as it is, for it may have
        been the object's before a merge.

    Raises
    ------
    UnknownTermError
        When no object has the name; it suggests the nearest one.
    UsageError
        When several objects have it.
    """
    found = find_object(select, name)
    if found is not None:
        return found
    if ":" in name and not any(c.isspace() for c in name):
        return name
    names = sorted({str(row["name"]) for row in _objects(select, "FILTER(BOUND(?name))")})
    hint = nearest(name, names) or "; `rtask objects list` shows what there is"
    raise UnknownTermError(f"no object is called {name!r}{hint}")


def _objects(select: Select, condition: str) -> Sequence[Mapping[str, Any]]:
    from rtask.rdf.namespaces import PREFIXES

    return select(f"""{PREFIXES}
SELECT DISTINCT ?object ?name WHERE {{
  ?object rt:objectId ?id . OPTIONAL {{ ?object rt:name ?name }} {condition} }}""")
