"""Values by which things are put in order: masses, distances, and when they were seen."""

from __future__ import annotations

import datetime
from collections.abc import Sequence
from dataclasses import replace

from rtask.asking.questions.mentions import Mention
from rtask.errors import UsageError
from rtask.rdf.namespaces import PREFIXES
from rtask.rdf.terms import Term
from rtask.sparql.results import Solutions
from rtask.tasks.actions import Select
from rtask.tasks.language.meaning import Phrase, Place, Quantity, Superlative
from rtask.tasks.language.patterns import MAX_EXEMPLARS, exemplars_of, fitting, value_of

__all__ = ["measured", "most", "ranked", "with_chosen"]

_FUNCTIONS = "PREFIX rtf: <https://w3id.org/rtask-kg/functions#>\n"
_WITHIN_M = 1000
"""Beyond any lab: the place service asks for a bound."""
_TIE = 1e-9


def with_chosen(select: Select, phrase: Phrase) -> list[str]:
    """Return the conditions of a phrase, of its superlatives those that choose what has most now.

    "All cups except the heaviest" leaves one out, which the graph alone knows.
    """
    phrase = measured(select, phrase)
    plain = tuple(item for item in phrase.left_out if item.superlative is None)
    conditions = list(fitting(replace(phrase, left_out=plain)))
    for left_out in phrase.left_out:
        if left_out.superlative is not None:
            among = with_chosen(select, replace(left_out, superlative=None))
            things = most(select, left_out, among)
            conditions.append(f"FILTER(?thing NOT IN ({', '.join(map(str, things))}))")
    if phrase.superlative is not None:
        things = most(select, phrase, conditions)
        if things:
            conditions = [f"VALUES ?thing {{ {' '.join(map(str, things))} }}"]
    return conditions


def measured(select: Select, phrase: Phrase) -> Phrase:
    """Return a phrase whose comparisons with a thing are comparisons with its measure.

    Raises
    ------
    UsageError
        Which thing is meant is not said, or nobody has measured it.
    """
    comparisons = []
    for item in phrase.comparisons:
        if item.than is not None:
            values = _measures(select, with_chosen(select, item.than), item.measure)
            things = exemplars_of(select, with_chosen(select, item.than))
            if len(things) != 1:
                raise UsageError(
                    f"which {item.than.text} a {item.measure} is compared with is not said: the "
                    f"graph knows of {len(things)}"
                )
            if not values:
                raise UsageError(f"the {item.measure} of {item.than.text} is not known: state it")
            item = replace(item, value=next(iter(values.values())), than=None)
        comparisons.append(item)
    left_out = tuple(measured(select, item) for item in phrase.left_out)
    return replace(phrase, comparisons=tuple(comparisons), left_out=left_out)


def most(select: Select, phrase: Phrase, conditions: Sequence[str]) -> list[Term]:
    """Return the things that have the most, or least, of a measure.

    Raises
    ------
    UsageError
        Several are alike at the bound, so that which of them is meant is not said.
    """
    assert phrase.superlative is not None
    values = ranked(select, conditions, phrase.superlative)
    sign = -1 if phrase.superlative.is_most else 1
    order = sorted(values, key=lambda thing: (sign * values[thing], str(thing)))
    quantity = phrase.quantity or Quantity("some", 1)
    if quantity.total and len(order) != quantity.total:
        raise UsageError(
            f"{phrase.text}: of {quantity.total} one is meant, and the graph knows of {len(order)}"
        )
    number = int(quantity.number)
    chosen = order[:number]
    if len(order) > number and abs(values[order[number]] - values[chosen[-1]]) < _TIE:
        raise UsageError(
            f"several {phrase.text} are alike, so that which {number} is meant is not said"
        )
    return chosen


def ranked(
    select: Select, conditions: Sequence[str], superlative: Superlative
) -> dict[Term, float]:
    """Return the value of each thing by which it is the heaviest, nearest, or seen last.

    Raises
    ------
    UsageError
        It is not known of some of them, so that which has most of it is not known either.
    """
    if superlative.measure == "distance":
        if superlative.to is None:
            raise UsageError(f"{superlative.text}: to what is not said")
        values = _distances(select, conditions, superlative.to)
        lacking = f"how far {{}} is from {superlative.to.text} is not known"
    elif superlative.measure == "seen":
        values = _sightings(select, conditions)
        lacking = "when {} was seen is not known"
    else:
        values = _measures(select, conditions, superlative.measure)
        lacking = f"the {superlative.measure} of {{}} is not known"
    for thing in exemplars_of(select, conditions):
        if thing not in values and not _is_reference(select, superlative.to, thing):
            raise UsageError(
                f"{lacking.format(thing)}, so that it is not known which has the most or least: "
                "state it"
            )
    return values


def _is_reference(select: Select, to: Place | None, thing: Term) -> bool:
    """Return whether a thing is what distances count from, which is not near itself."""
    if to is not None and to.holds is not None:
        return thing in exemplars_of(select, with_chosen(select, to.holds))
    mention = to.names[0].role("thing", "object") if to is not None else None
    return mention is not None and to is not None and thing in _terms_of(select, mention)


def _measures(select: Select, conditions: Sequence[str], measure: str) -> dict[Term, float]:
    rows = select(
        f"{PREFIXES}SELECT ?thing (MAX(?v) AS ?value) WHERE {{ {' . '.join(conditions)} "
        f"{value_of(measure, 'v')} }} GROUP BY ?thing LIMIT {MAX_EXEMPLARS}"
    )
    return _by_object(rows)


def _distances(select: Select, conditions: Sequence[str], to: Place) -> dict[Term, float]:
    """Return the distances between origins, in metres, of what is in one tree of frames."""
    things = exemplars_of(select, conditions)
    if not things:
        return {}
    listed = " ".join(map(str, things))
    rows = select(
        f"{PREFIXES}{_FUNCTIONS}SELECT ?thing (MIN(?metres) AS ?value) WHERE {{ "
        f"VALUES ?thing {{ {listed} }} SERVICE <urn:rtask:place> {{ ?thing rtf:near "
        f"{_reference(select, to)} ; rtf:within {_WITHIN_M} ; rtf:distance ?metres }} }} "
        "GROUP BY ?thing"
    )
    return _by_object(rows)


def _reference(select: Select, to: Place) -> Term:
    """Return the one thing, robot or place that distances count from."""
    if to.holds is not None:
        terms = tuple(exemplars_of(select, with_chosen(select, to.holds)))
    else:
        mention = to.names[0].role("place", "robot", "thing", "object")
        assert mention is not None
        terms = _terms_of(select, mention)
    if len(terms) != 1:
        raise UsageError(
            f"nearest to which {to.text} is not said: the graph knows of {len(terms)}; name it"
        )
    return terms[0]


def _terms_of(select: Select, mention: Mention) -> tuple[Term, ...]:
    """Return what a name stands for; of a product, its things."""
    if mention.role != "object":
        return mention.terms
    written = " ".join(map(str, mention.terms))
    return tuple(exemplars_of(
        select, [f"VALUES ?of {{ {written} }} ?thing rt:exemplarOf ?of",
                 "FILTER NOT EXISTS { ?thing rt:mergedInto ?into }"]
    ))  # fmt: skip


def _sightings(select: Select, conditions: Sequence[str]) -> dict[Term, float]:
    """Return when things were last seen, in Unix time; what is only stated was not seen."""
    rows = select(
        f"{PREFIXES}SELECT ?thing ?when WHERE {{ {' . '.join(conditions)} . "
        "?stay rt:placementOf ?thing . { ?stay rt:confirmedAt ?when } UNION { "
        "?stay rt:placementPose ?pose ; time:hasBeginning/time:inXSDDateTimeStamp ?when } }"
    )
    values: dict[Term, float] = {}
    for row in rows:
        thing, when = row["thing"], row["when"]
        assert thing is not None
        assert when is not None
        seconds = datetime.datetime.fromisoformat(str(getattr(when, "value", when))).timestamp()
        values[thing] = max(seconds, values.get(thing, seconds))
    return values


def _by_object(rows: Solutions) -> dict[Term, float]:
    values: dict[Term, float] = {}
    for row in rows:
        thing = row["thing"]
        if thing is not None and row["value"] is not None:
            values[thing] = float(str(row.value("value")))
    return values
