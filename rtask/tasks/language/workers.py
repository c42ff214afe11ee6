"""Who is to reach a goal, where its words say so: "nao-1 should put the pen into the left box"."""

from __future__ import annotations

import re
from typing import NamedTuple

from rtask.errors import UsageError
from rtask.rdf.namespaces import PREFIXES
from rtask.rdf.terms import Literal
from rtask.tasks.actions import Select
from rtask.tasks.language.lexicon import AWAY, GRASP, PUT, TAKE

__all__ = ["Worker", "worker_in"]

_ROBOT = r"(?P<the>the\s+)?(?P<name>[\w-]+)"
_BEFORE = r"^\s*(?:please,?\s+)?"
_PATTERNS = tuple(
    re.compile(_BEFORE + pattern + r"\s+(?P<deed>\w.*)$", re.I | re.S)
    for pattern in (
        rf"{_ROBOT}\s+(?:should|must|shall|ought\s+to|has\s+to|needs\s+to|is\s+to)",
        rf"(?:have|let|make)\s+{_ROBOT}",
        rf"(?:get|ask|tell|(?:i|we)\s+(?:would\s+)?(?:want|like|need))\s+{_ROBOT}\s+to",
        rf"{_ROBOT}\s*[,:](?:\s*please\b,?)?",
    )
)
_VERBS = PUT | GRASP | TAKE | AWAY | {
    "clear", "empty", "tidy", "unload", "swap", "exchange", "remove", "fill", "load", "unpack",
}  # fmt: skip
_OTHERS = re.compile(
    r"\b(?:you|u|i|we|he|she|they|somebody|someone|anybody|anyone|everyone|robots?|else|itself|"
    r"himself|together|help|should|must|shall|will|would|can|could|may|might|ought|goes|go|"
    r"belongs?|needs?|has|have|wants?|let|please|by|with|using)\b|[.;!?]\s*\w",
    re.I,
)
"""What may begin a part of the goal that is somebody else's, so that whose it is is not clear."""
_NUMBER = re.compile(r"-\d+$")


class Worker(NamedTuple):
    """The robot that a goal names, and what is left of its words."""

    iri: str
    name: str
    deed: str


def worker_in(select: Select, text: str) -> Worker | None:
    """Return the robot that is to reach all of a goal alone; None where no robot clearly is.

    Parameters
    ----------
    text
        The goal without a deadline.

    Raises
    ------
    UsageError
        "The panda" is said where there are several.
    """
    matches = [match for pattern in _PATTERNS if (match := pattern.match(text)) is not None]
    if not matches:
        return None
    robots, things = _named(select)
    for match in matches:
        said, deed = match["name"].lower(), match["deed"]
        # A toy panda may be called so as well: what is named then is for the grammar to say.
        if said in things or not _is_of_one(deed, {name for name, _ in robots}):
            continue
        found = [(name, iri) for name, iri in robots if said == name.lower()] or [
            (name, iri) for name, iri in robots
            if match["the"] and said == _NUMBER.sub("", name.lower())
        ]  # fmt: skip
        if len(found) > 1:
            listed = " or ".join(sorted(name for name, _ in found))
            raise UsageError(f"which {match['name']} is to do it is not said: {listed}")
        if found:
            return Worker(found[0][1], found[0][0], deed)
    return None


def _is_of_one(deed: str, robots: set[str]) -> bool:
    """Return whether words are one order to one robot, which names no other one."""
    words = re.findall(r"[\w-]+", deed.lower())
    names = {name.lower() for name in robots}
    names |= {_NUMBER.sub("", name) for name in names}
    return words[0] in _VERBS and not names.intersection(words) and not _OTHERS.search(deed)


def _named(select: Select) -> tuple[list[tuple[str, str]], set[str]]:
    """Return the name and IRI of each robot, and the names of products, in lower case."""
    rows = select(
        f"{PREFIXES}SELECT DISTINCT ?x ?name WHERE {{ ?x a cora:Robot ; rt:name ?name }} "
        "ORDER BY ?name ?x LIMIT 500"
    )
    robots = [(str(row.value("name")), str(row.value("x"))) for row in rows]
    called = {_NUMBER.sub("", name.lower()) for name, _ in robots} | {
        name.lower() for name, _ in robots
    }
    written = " ".join(str(Literal(name)) for name in sorted(called))
    rows = select(
        f"{PREFIXES}SELECT DISTINCT ?low WHERE {{ VALUES ?low {{ {written} }} "
        "?x a rt:ManipulableObject ; rt:name ?name FILTER(LCASE(STR(?name)) = ?low) }"
    )
    return robots, {str(row.value("low")) for row in rows}
