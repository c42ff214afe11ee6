"""What stands in the way where a place is full, or a hand not gentle enough, and what would do."""

from __future__ import annotations

from rtask.rdf.namespaces import PREFIXES, RT
from rtask.rdf.terms import NamedNode
from rtask.tasks.actions import Select
from rtask.tasks.names import names_of
from rtask.tasks.planning.problem import Atom
from rtask.tasks.steps import Wording, excluded_by, excluded_link

__all__ = ["is_measured", "measures_in_words", "mended_by"]

_MAX_LISTED = 3
_FORCES = """
SELECT (MAX(?f) AS ?least) (MIN(?c) AS ?most) WHERE {
  %s rt:minForce ?f . { %s rt:crushingForce ?c } UNION { %s rt:exemplarOf/rt:crushingForce ?c }
}"""
_CONTENTS = """
SELECT DISTINCT ?x WHERE { ?x a rt:Exemplar ; rt:locatedOn %s } ORDER BY ?x LIMIT 1000"""
_OTHERS = """
SELECT DISTINCT ?x WHERE {
  ?robot rt:reaches %s, ?x . ?x a rt:SupportSurface
  FILTER(?x != %s) FILTER NOT EXISTS { ?x a rt:Full } FILTER NOT EXISTS { ?x a rt:Shut }
} ORDER BY ?x LIMIT 1000"""


def measures_in_words(select: Select, atom: Atom, wording: Wording) -> str:
    """Return why a place has no room, or a hand is not gentle enough; "" for another condition."""
    place = _full_place(atom)
    if place:
        number = len(_iris(select, _CONTENTS % NamedNode(place)))
        things = "1 thing is" if number == 1 else f"{number} things are"
        return f"{wording.name(place)} is full: {things} there"
    link = excluded_link(atom)
    if link is None or link[1] != RT.crushedBy.value:
        return ""
    name, hand = wording.name(link[0]), wording.name(link[2])
    least, most = _forces(select, link)
    if least is None or most is None:
        return f"{hand} crushes {name}"
    return f"{name} bears {most:.1f} N, and {hand} closes with no less than {least:.1f} N"


def mended_by(select: Select, atom: Atom, wording: Wording) -> str:
    """Return what would do instead, beside that the statement is withdrawn; "" for nothing."""
    place = _full_place(atom)
    if place:
        inside = _iris(select, _CONTENTS % NamedNode(place))
        others = _iris(select, _OTHERS % (NamedNode(place), NamedNode(place)))
        names = names_of(select, {*inside, *others})
        ways = [f"take something out ({_listed(inside, names)})"] if inside else []
        ways += [f"say another place ({_listed(others, names)})"] if others else []
        return " or ".join(ways)
    link = excluded_link(atom)
    if link is None or link[1] != RT.crushedBy.value:
        return ""
    _, most = _forces(select, link)
    gentle = f"less than {most:.1f} N" if most is not None else "less force"
    return f"a robot there with a hand that closes with {gentle} would"


def is_measured(select: Select, link: tuple[str, str, str]) -> bool:
    """Return whether a link follows from measures, so that nothing can be withdrawn."""
    return link[1] == RT.crushedBy.value and None not in _forces(select, link)


def _full_place(atom: Atom) -> str:
    excluded = excluded_by(atom)
    return excluded[0] if excluded is not None and excluded[1] == RT.Full.value else ""


def _forces(select: Select, link: tuple[str, str, str]) -> tuple[float | None, float | None]:
    """Return the least force of a hand and the most that a thing bears, N, where they are known."""
    what, hand = NamedNode(link[0]), NamedNode(link[2])
    row = select(PREFIXES + _FORCES % (hand, what, what))[0]
    values = (row.value("least"), row.value("most"))
    least, most = (float(value) if isinstance(value, int | float) else None for value in values)
    return least, most


def _iris(select: Select, query: str) -> list[str]:
    return [str(row.value("x")) for row in select(PREFIXES + query)]


def _listed(iris: list[str], names: dict[str, str]) -> str:
    listed = sorted(names[iri] for iri in iris)
    more = f" and {len(listed) - _MAX_LISTED} more" if len(listed) > _MAX_LISTED else ""
    return ", ".join(listed[:_MAX_LISTED]) + more
