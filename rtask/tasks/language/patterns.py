"""Phrases and places as SPARQL: which things fit, and which places will do."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from rtask.asking.questions.mentions import Mention
from rtask.asking.questions.words import stem
from rtask.errors import UsageError
from rtask.rdf.namespaces import PREFIXES
from rtask.rdf.terms import Literal, Term
from rtask.tasks.actions import Select
from rtask.tasks.language.lexicon import MEASURES
from rtask.tasks.language.meaning import Comparison, Name, Phrase, Place

__all__ = ["EARLIER", "HAND", "MAX_EXEMPLARS", "destination", "elsewhere", "exemplars_of",
           "fitting", "value_of"]  # fmt: skip

HAND = "?robot a cora:Robot ; rt:hasEndEffector ?place"
EARLIER = """?was rt:placementOf ?thing ; rt:placedOn|rt:placedIn ?place ;
  time:hasEnd/time:inXSDDateTimeStamp ?end . ?place a rt:SupportSurface . FILTER NOT EXISTS {
    ?later rt:placementOf ?thing ; rt:placedOn|rt:placedIn ?other ;
      time:hasEnd/time:inXSDDateTimeStamp ?later_end . ?other a rt:SupportSurface
    FILTER(?later_end > ?end) } FILTER NOT EXISTS { ?thing rt:locatedOn ?place }"""
"""That a place is the one where a thing was last, the present one and hands aside."""
_UNMERGED = "FILTER NOT EXISTS { ?thing rt:mergedInto ?merged }"
_OWN = {"rt:effectiveMass": "(rt:effectiveMass|rt:exemplarOf/rt:effectiveMass)"}
MAX_EXEMPLARS = 2000


def fitting(phrase: Phrase, prefix: str = "subject") -> Iterator[str]:
    """Yield the conditions that ``?thing`` is what a phrase says, but for its superlative."""
    yield "?thing a rt:Exemplar"
    for at, name in enumerate(phrase.heads):
        yield _named(name, f"{prefix}{at}")
    for number, (names, is_not) in enumerate(phrase.colours):
        variable = f"{prefix}_colour{number}"
        way = _with_property("rt:hasColour", names, "colour", is_not, variable)
        yield way if is_not or not phrase.heads else _or_called(way, names, phrase.heads[-1])
    for number, (names, is_not) in enumerate(phrase.traits):
        if is_not:
            # Nobody states that a thing is not fragile, so that this cannot be known.
            raise UsageError(f"which things are not {names[0].text} is not known: nobody states it")
        yield _with_property("rt:hasTrait", names, "trait", False, f"{prefix}_trait{number}")
    for number, (names, is_not) in enumerate(phrase.materials):
        variable = f"{prefix}_material{number}"
        yield _with_property("rt:surfaceMaterial", names, "material", is_not, variable)
    for number, name in enumerate(phrase.kinds_not):
        yield f"MINUS {{ ?thing a rt:Exemplar . {_named(name, f'{prefix}_not{number}')} }}"
    for number, (place, is_not) in enumerate(phrase.places):
        yield _located(place, is_not, f"{prefix}_source{number}")
    for number, name in enumerate(phrase.owners):
        variable = f"{prefix}_owner{number}"
        theirs = _terms(variable, _role(name, "owner").terms)
        own, of_product = f"BIND(?{variable} AS ?thing)", f"?thing rt:exemplarOf ?{variable}"
        yield f"{{ {theirs} {own} }} UNION {{ {theirs} {of_product} }}"
    for number, (robot, is_not) in enumerate(phrase.reached_by):
        yield _reached(robot, is_not, f"{prefix}_reach{number}")
    for number, comparison in enumerate(phrase.comparisons):
        yield _compared(comparison, f"{prefix}_value{number}")
    for number, left_out in enumerate(phrase.left_out):
        yield f"MINUS {{ {' . '.join(fitting(left_out, f'{prefix}_out{number}_'))} }}"
    if not phrase.heads and not phrase.places:
        yield f"?thing rt:locatedOn ?{prefix}_anywhere"
    yield _UNMERGED


def _named(name: Name, variable: str) -> str:
    """Return the condition that things fit a name; where it can mean several, any of these.

    A kind means what is called so as well, as in questions: nobody need have classified carton-6.
    """
    # Groups and MINUS do not see ?thing from outside: each way has to bind it by itself.
    ways = {
        "kind": "?thing rt:exemplarOf/a ?%s", "object": "?thing rt:exemplarOf ?%s",
        "thing": "BIND(?%s AS ?thing)", "use": "?thing rt:exemplarOf/rt:hasFunction ?%s",
    }  # fmt: skip
    of = [item for item in name.mentions if item.role in ways]
    parts = [f"{{ {_terms(variable, item.terms)} {ways[item.role] % variable} }}" for item in of]
    called = " ".join(str(term) for item in of if item.role == "kind" for term in item.called)
    if called:
        parts.append(f"{{ VALUES ?{variable} {{ {called} }} ?thing rt:exemplarOf ?{variable} }}")
    return " UNION ".join(parts)


def _with_property(prop: str, names: Sequence[Name], role: str, is_not: bool, variable: str) -> str:
    terms = [term for name in names for term in _role(name, role).terms]
    way = f"rt:exemplarOf/{prop}"
    if not is_not:
        return f"{_terms(variable, terms)} ?thing {way} ?{variable}"
    # Of what nobody has seen the colour of, it is not known that it is not red.
    return (
        f"?thing {way} ?{variable}_any . FILTER NOT EXISTS {{ {_terms(variable, terms)} "
        f"?thing {way} ?{variable} }}"
    )


def _or_called(way: str, names: Sequence[Name], head: Name) -> str:
    """Return a condition, or that things are called so: "the red one" may be named red cup."""
    called = {
        f"{name.text} {noun}".lower() for name in names for noun in (head.text, stem(head.text))
    }
    written = ", ".join(str(Literal(text)) for text in sorted(called))
    return (
        f"{{ {way} }} UNION {{ ?thing rt:exemplarOf/rt:name ?called "
        f"FILTER(LCASE(STR(?called)) IN ({written})) }}"
    )


def _located(place: Place, is_not: bool, variable: str) -> str:
    terms = _terms(variable, places_of(place))
    owner = ""
    if place.owner is not None:
        robots = _role(place.owner, "robot").terms
        owner = f" . {_terms(f'{variable}_owner', robots)} ?{variable}_owner rt:reaches ?{variable}"
    if not is_not:
        return f"{terms} ?thing rt:locatedOn ?{variable}{owner}"
    return (
        f"?thing rt:locatedOn ?{variable}_any . FILTER NOT EXISTS {{ {terms} "
        f"?thing rt:locatedOn ?{variable}{owner} }}"
    )


def _reached(robot: Name, is_not: bool, variable: str) -> str:
    if is_not:
        raise UsageError(
            f"what is out of reach of {robot.text} is not known: nobody states that a robot does "
            "not reach a place; name the things, or the place"
        )
    terms = _terms(f"{variable}_robot", _role(robot, "robot").terms)
    return f"{terms} ?{variable}_robot rt:reaches ?{variable} . ?thing rt:locatedOn ?{variable}"


def _compared(comparison: Comparison, variable: str) -> str:
    sign = ">" if comparison.is_above else "<"
    value = value_of(comparison.measure, variable)
    return f"{value} FILTER(?{variable} {sign} {comparison.value:e})"


def value_of(measure: str, variable: str) -> str:
    """Return the condition that ``?variable`` is a measure of ``?thing``."""
    prop = MEASURES[measure]
    if prop:
        return f"?thing {_OWN.get(prop, f'rt:exemplarOf/{prop}')} ?{variable}"
    axes = " ".join(f"rt:extent{axis} ?{variable}_{axis.lower()} ;" for axis in "XYZ").rstrip(" ;")
    return (
        f"?thing rt:exemplarOf ?{variable}_of . ?{variable}_of {axes} "
        f"BIND(?{variable}_x * ?{variable}_y * ?{variable}_z AS ?{variable})"
    )


def exemplars_of(select: Select, conditions: Sequence[str]) -> dict[Term, frozenset[Term]]:
    """Return each thing that fits, with the places where it is.

    Raises
    ------
    UsageError
        More fit than are looked at: of the others it would not be known what they are.
    """
    rows = select(
        f"{PREFIXES}SELECT DISTINCT ?thing ?now WHERE {{ {' . '.join(conditions)} "
        f"OPTIONAL {{ ?thing rt:locatedOn ?now }} }} LIMIT {MAX_EXEMPLARS + 1}"
    )
    if len(rows) > MAX_EXEMPLARS:
        raise UsageError(f"more than {MAX_EXEMPLARS} things fit: say of fewer, or where they are")
    matches: dict[Term, set[Term]] = {}
    for row in rows:
        thing, now = row["thing"], row["now"]
        assert thing is not None
        places = matches.setdefault(thing, set())
        if now is not None:
            places.add(now)
    return {thing: frozenset(places) for thing, places in matches.items()}


def places_of(place: Place) -> list[Term]:
    """Return the places that a name of one can stand for."""
    return [term for name in place.names for term in _role(name, "place").terms]


def destination(select: Select, target: Place, held: Sequence[str] = ()) -> str:
    """Return the condition that ``?place`` is one that a target allows.

    Parameters
    ----------
    held
        The conditions of what is there now, if the target says that.

    Raises
    ------
    UsageError
        The target is where something is, and nobody knows where that is, or it is at several.
    """
    if target.holds is not None:
        matches = exemplars_of(select, held)
        places = {place for of in matches.values() for place in of}
        if len(places) != 1:
            raise UsageError(
                f"{target.text!r} is {'no place that is known' if not places else 'no one place'}"
            )
        return _terms("place", sorted(places, key=str))
    first = target.names[0]
    if first.role("place"):
        owned = ""
        if target.owner is not None:
            robots = _role(target.owner, "robot").terms
            owned = f" {_terms('owner', robots)} ?owner rt:reaches ?place ."
        return f"{owned} {_terms('place', places_of(target))}"
    mention = first.role("robot", "thing", "object")
    assert mention is not None
    terms = _terms("target", mention.terms)
    if mention.role == "robot":
        return f"{terms} ?target rt:hasEndEffector ?place"
    if mention.role == "object":
        return f"{terms} {{ BIND(?target AS ?place) }} UNION {{ ?place rt:exemplarOf ?target }}"
    return _terms("place", mention.terms)


def elsewhere(places: Sequence[Term]) -> str:
    """Return the condition that ``?place`` is one that robots reach, and none of some."""
    return f"?robot rt:reaches ?place FILTER(?place NOT IN ({', '.join(map(str, places))}))"


def _role(name: Name, role: str) -> Mention:
    mention = name.role(role)
    if mention is None:
        raise UsageError(f"{name.text!r} is no {role}")
    return mention


def _terms(name: str, terms: Sequence[Term]) -> str:
    return f"VALUES ?{name} {{ {' '.join(map(str, terms))} }}"
