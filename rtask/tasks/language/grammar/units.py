"""What a clause leaves to its neighbours: nouns, places, "it" and "the rest"."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

from rtask.tasks.language.grammar.clause import Clause
from rtask.tasks.language.meaning import Condition, Deed, Phrase, Place, Quantity

__all__ = ["Resolved", "Unit", "Units", "is_separate", "resolved_deeds"]


@dataclass(frozen=True)
class Unit:
    """A clause in its place: after which separator, under which conditions.

    Parameters
    ----------
    is_later
        What it says is begun after what stands before it.
    conditions
        Each with whether the goal is to be reached if it holds.
    """

    clause: Clause
    is_later: bool = False
    conditions: tuple[tuple[Condition, bool], ...] = ()
    firsts: tuple[Phrase, ...] = ()

    @property
    def is_limit(self) -> bool:
        """Whether it only says what may not be done, or who may do it."""
        return any(deed.is_limit for deed in self.clause.deeds)


_Conditions = tuple[tuple[Condition, bool], ...]
Units = tuple[Unit, ...]
Resolved = tuple[tuple[Deed, _Conditions], ...]


def resolved_deeds(units: Units) -> Resolved | None:
    """Return the deeds of a text of which each says all by itself; None where that cannot be.

    Limits come last: they are of all deeds, and nothing that is left out is theirs.
    """
    limits = tuple((d, u.conditions) for u in units if u.is_limit for d in u.clause.deeds)
    units = _without_topics(tuple(unit for unit in units if not unit.is_limit)) or ()
    if not units or not is_separate(units):
        return None
    spared = tuple(deed.phrase for deed, when in limits if deed.kind == "untouched" and not when)
    filled = _with_ends(list(units))
    if filled is None:
        return None
    resolved: list[tuple[Deed, tuple[tuple[Condition, bool], ...]]] = []
    topics: list[Deed] = []
    stage = 0
    for number, unit in enumerate(filled):
        if unit.clause.is_topic:
            topics += unit.clause.deeds
            continue
        is_later = unit.is_later and bool(number)
        was_first = bool(number) and filled[number - 1].clause.order == "first"
        stage += is_later or was_first
        conditions = unit.conditions
        for deed in unit.clause.deeds:
            own = replace(deed.phrase, anaphor="") if deed.phrase.anaphor == "all" else deed.phrase
            own = _rest_of(own, spared) if not resolved else own
            phrase = _with_heads(own, unit, topics, [done for done, _ in resolved])
            if phrase is not None and topics and not _is_within(phrase, topics):
                return None
            done = _in_place(replace(deed, phrase=phrase), unit, resolved) if phrase else None
            if done is None or not _is_sensible(done):
                return None
            named = _with_places(done, unit.conditions)
            if named is None:
                return None
            done, conditions = _each(done, named)
            for first in _first_ones(done, unit.firsts) or ():
                resolved.append((replace(first, stage=stage), conditions))
            stage += bool(unit.firsts)
            resolved.append((replace(done, stage=stage), conditions))
    return (*_without_spared(resolved, spared), *limits)


def _rest_of(phrase: Phrase, spared: tuple[Phrase, ...]) -> Phrase:
    """Return "the rest", where only what is not to be touched was named before."""
    if not phrase.others or not spared:
        return phrase
    return replace(phrase, others=False, left_out=(*phrase.left_out, *spared))


def _without_spared(
    resolved: Sequence[tuple[Deed, _Conditions]], spared: tuple[Phrase, ...]
) -> Resolved:
    """Return deeds in which "everything" is without what is to stay, or not to be touched.

    Things that a goal names itself are not left out: that would be two orders against each other.
    """
    spared += tuple(deed.phrase for deed, when in resolved
                  if deed.kind == "stay" and not when and not deed.phrase.others)  # fmt: skip
    result = []
    for deed, conditions in resolved:
        phrase = deed.phrase
        is_all = phrase.is_generic and not phrase.heads and not phrase.others
        if is_all and deed.kind != "stay" and phrase.quantity in (None, Quantity("all")):
            left_out = tuple(item for item in spared if item not in phrase.left_out)
            deed = replace(deed, phrase=replace(phrase, left_out=(*phrase.left_out, *left_out)))
        result.append((deed, conditions))
    return tuple(result)


def _first_ones(deed: Deed, firsts: tuple[Phrase, ...]) -> list[Deed]:
    """Return the deeds for those things of a deed that come first."""
    result = []
    for phrase in firsts:
        both = replace(
            deed.phrase, colours=deed.phrase.colours + phrase.colours,
            traits=deed.phrase.traits + phrase.traits,
            materials=deed.phrase.materials + phrase.materials,
            kinds_not=deed.phrase.kinds_not,
            heads=deed.phrase.heads if phrase.is_elided else deed.phrase.heads + phrase.heads,
        )  # fmt: skip
        result.append(replace(deed, phrase=both))
    return result


def is_separate(units: Units) -> bool:
    """Return whether clauses that only name things are no list, which is read as one."""
    for before, after in pairwise(units):
        is_bare = before.clause.is_open and not before.clause.order
        if is_bare and not after.is_later and not after.clause.has_verb:
            return False
        # What follows what is left out is left out as well: "except the cups, pens and the jug".
        leaves_out = any(deed.phrase.left_out for deed in before.clause.deeds)
        if leaves_out and after.clause.is_open and not (after.clause.has_verb or after.is_later):
            return False
    return True


def _without_topics(units: Units) -> Units | None:
    """Return clauses in which "it" and "them" are what the clause before, or a condition, names.

    "take the can and put it into the box" is one deed.
    """
    result: list[Unit] = []
    for unit in units:
        anaphors = [d for d in unit.clause.deeds if d.phrase.anaphor not in ("", "all")]
        if not anaphors:
            result.append(unit)
            continue
        if len(anaphors) != 1 or len(unit.clause.deeds) != 1:
            return None
        before = result[-1] if result else None
        is_taken = before is not None and (
            before.clause.takes
            or (before.clause.is_open and not before.clause.has_verb)
            or all(deed.kind in ("hold", "away") for deed in before.clause.deeds)
        )
        if is_taken and before is not None:
            phrases = tuple(_from(deed) for deed in before.clause.deeds)
            deeds = tuple(replace(anaphors[0], phrase=phrase) for phrase in phrases)
            result[-1] = replace(
                unit,
                clause=replace(unit.clause, deeds=deeds),
                is_later=before.is_later,
                conditions=before.conditions or unit.conditions,
            )
            continue
        if before is not None and _are_opposite(before.conditions, unit.conditions):
            deeds = tuple(replace(anaphors[0], phrase=d.phrase) for d in before.clause.deeds)
            result.append(replace(unit, clause=replace(unit.clause, deeds=deeds)))
            continue
        asked = [item.phrase for item, _ in unit.conditions if item.phrase is not None]
        if len(asked) != 1 or (before is not None and before.conditions == unit.conditions):
            return None
        quality = next(item.quality for item, _ in unit.conditions if item.phrase is not None)
        phrase = asked[0]
        if quality is not None and phrase.quantity == Quantity("some", 1):
            # "if a cup is on the table, put it away" is about the one that is there.
            phrase = replace(phrase, places=phrase.places + quality.places)
        deed = replace(anaphors[0], phrase=phrase)
        result.append(replace(unit, clause=replace(unit.clause, deeds=(deed,))))
    return tuple(result)


def _are_opposite(conditions: _Conditions, others: _Conditions) -> bool:
    """Return whether one of two holds exactly where the other does not: "otherwise"."""
    return bool(conditions) and tuple((c, not is_due) for c, is_due in conditions) == others


def _from(deed: Deed) -> Phrase:
    """Return the phrase of a deed, with the place that its things are taken away from."""
    if deed.kind != "away" or deed.source is None:
        return deed.phrase
    return replace(deed.phrase, places=(*deed.phrase.places, (deed.source, False)))


def _with_ends(units: list[Unit]) -> list[Unit] | None:
    """Return clauses of which those without a place of their own have that of their neighbours."""
    is_lent = False
    for at in range(len(units) - 2, -1, -1):
        unit, after = units[at], units[at + 1]
        # "two cups on the shelf, then one in the box" says where to twice.
        is_bare = not any(deed.phrase.places for deed in unit.clause.deeds) or any(
            deed.phrase.places for deed in after.clause.deeds
        )
        is_ended = not after.clause.is_open and not after.clause.has_verb
        if unit.clause.is_open and is_bare and is_ended:
            units[at] = _ending(unit, after.clause)
            is_lent |= at == len(units) - 2
    for at in range(1, len(units)):
        unit, before = units[at], units[at - 1]
        is_bare = not unit.clause.has_verb and not any(d.phrase.places for d in unit.clause.deeds)
        if unit.clause.is_open and is_bare and not before.clause.is_open:
            units[at] = _ending(unit, before.clause)
    if is_lent and [deed.phrase.anaphor for deed in units[-1].clause.deeds] == ["all"]:
        units.pop()  # "the cups first, the pens afterwards, all into the right box"
    return (
        None if any(unit.clause.is_open and not unit.clause.is_topic for unit in units) else units
    )


def _ending(unit: Unit, clause: Clause) -> Unit:
    """Return a clause that ends as another does."""
    model = clause.deeds[0]
    if model.kind != "put":
        return unit
    deeds = tuple(replace(deed, kind="put", target=model.target) for deed in unit.clause.deeds)
    return replace(unit, clause=replace(unit.clause, deeds=deeds, is_open=False))


def _is_within(phrase: Phrase, topics: list[Deed]) -> bool:
    """Return whether a phrase is about what a sentence was said to be about."""
    return any(phrase.heads == deed.phrase.heads for deed in topics)


def _with_heads(
    phrase: Phrase, unit: Unit, topics: list[Deed], resolved: list[Deed]
) -> Phrase | None:
    """Return a phrase with the noun, and the others, that it leaves to its neighbours."""
    before = topics + resolved
    if phrase.others:
        return _other(phrase, before) if resolved else None
    if not phrase.is_elided:
        return phrase
    phrases = [deed.phrase for deed in unit.clause.deeds]
    following = phrases[phrases.index(phrase) + 1 :] if phrase in phrases else []
    preceding = phrases[: phrases.index(phrase)] if phrase in phrases else []
    whole = next((item for item in reversed(preceding) if not item.is_elided), None)
    if whole is not None:  # "one red cup and two blue ones"
        return replace(phrase, heads=whole.heads, is_generic=whole.is_generic, is_elided=False)
    model = next((item for item in following if not item.is_elided), None)
    if model is not None and phrase.is_described:
        return replace(phrase, heads=model.heads, is_generic=model.is_generic, is_elided=False,
                       is_plural=model.is_plural)  # fmt: skip
    if model is not None:
        return None
    if before and (phrase.quantity is not None or phrase.is_described):
        last = before[-1].phrase
        return replace(phrase, heads=last.heads, is_generic=last.is_generic, is_elided=False)
    # "the yellow one" is the only yellow thing, or refused where there are several.
    is_single = phrase.is_definite and not phrase.is_plural and phrase.superlative is None
    if phrase.is_described and (phrase.quantity == Quantity("all") or is_single):
        return replace(phrase, is_generic=True, is_elided=False)
    return None


def _other(phrase: Phrase, before: list[Deed]) -> Phrase | None:
    """Return "the rest" and "the other cups" with what they are the rest of."""
    if not (phrase.is_elided or (phrase.is_generic and not phrase.places)):
        return phrase
    last = before[-1].phrase
    is_part = last.quantity is not None and last.quantity.kind in ("some", "exactly", "share")
    if is_part or (phrase.is_elided and len({deed.phrase.heads for deed in before}) == 1):
        return replace(phrase, heads=last.heads, places=last.places, is_elided=False,
                       is_generic=last.is_generic, is_plural=True)  # fmt: skip
    if phrase.is_elided or any(deed.phrase.places for deed in before):
        return None  # the rest of those, or of all?
    return phrase


def _in_place(deed: Deed, unit: Unit, resolved: Sequence[tuple[Deed, object]]) -> Deed | None:
    """Return a deed with the place that "there" and "it" stand for."""
    asked: set[Place] = set()
    for condition, _ in unit.conditions:
        places = [condition.place] if condition.place is not None else []
        for phrase in (condition.phrase, condition.quality):
            places += [place for place, _ in phrase.places] if phrase is not None else []
        asked.update(places)
    if len(asked) == 1:  # "if the table is not empty, put what is on it away"
        named = next(iter(asked))
        own = tuple((named if place.anaphor else place, is_not)
                    for place, is_not in deed.phrase.places)  # fmt: skip
        deed = replace(deed, phrase=replace(deed.phrase, places=own))
    if deed.target is None or not deed.target.anaphor:
        return deed
    if not asked:
        done = [item.target or item.source for item, _ in resolved]
        asked = {place for place in done[-1:] if place is not None}
    return replace(deed, target=next(iter(asked))) if len(asked) == 1 else None


def _with_places(deed: Deed, conditions: _Conditions) -> _Conditions | None:
    """Return conditions in which "it" is the place that a deed empties: "unless it is empty"."""
    result = []
    for condition, is_due in conditions:
        if condition.place is not None and condition.place.anaphor:
            sources = {place for place, is_not in deed.phrase.places if not is_not}
            sources |= {deed.source} if deed.source is not None else set()
            if len(sources) != 1:
                return None
            condition = replace(condition, place=next(iter(sources)))
        result.append((condition, is_due))
    return tuple(result)


def _each(
    deed: Deed, conditions: tuple[tuple[Condition, bool], ...]
) -> tuple[Deed, tuple[tuple[Condition, bool], ...]]:
    """Return a deed on conditions that are about each of its things: "unless they are red"."""
    left = []
    for condition, is_due in conditions:
        phrase, quality = condition.phrase, condition.quality
        if phrase is None or not phrase.anaphor or quality is None:
            left.append((condition, is_due))
            continue
        is_not = is_due == condition.is_not
        own = deed.phrase
        own = replace(
            own, colours=own.colours + tuple((n, is_not) for n, _ in quality.colours),
            traits=own.traits + tuple((n, is_not) for n, _ in quality.traits),
            materials=own.materials + tuple((n, is_not) for n, _ in quality.materials),
            places=own.places + tuple((place, is_not) for place, _ in quality.places),
        )  # fmt: skip
        deed = replace(deed, phrase=own)
    return deed, tuple(left)


def _is_sensible(deed: Deed) -> bool:
    """Return whether a deed is one that can be asked for."""
    phrases = [deed.phrase] + ([deed.partner] if deed.partner is not None else [])
    for phrase in phrases:
        if phrase.anaphor or phrase.is_elided:
            return False
        if not (phrase.heads or phrase.is_generic):
            return False
        if any(_is_from_nowhere(item) for item in (phrase, *phrase.left_out)):
            return False
        inner = [place for place, _ in phrase.places]
        if any(place.anaphor or place.holds is not None for place in inner):
            return False
        # What things are in or on now is a place, not a robot or another thing.
        if any(name.role("place") is None for place in inner for name in place.names):
            return False
    kind = deed.phrase.quantity.kind if deed.phrase.quantity is not None else ""
    if kind == "no" or (kind == "at_most" and deed.kind != "put"):
        return False
    if deed.kind == "put" and deed.target is None:
        return False
    held = deed.target.holds if deed.target is not None else None
    if held is not None and (held.anaphor or held.is_elided):  # "where it is" is no place to go
        return False
    if deed.target is not None and deed.target.names and not deed.target.names[0].role("place"):
        # "cup-1 on the can": neither of them is a place.
        return deed.target.names[0].role("robot") is not None or _carries(deed.target)
    return not (deed.source is not None and not all(
        name.role("place") for name in deed.source.names))  # fmt: skip


def _is_from_nowhere(phrase: Phrase) -> bool:
    """Return whether things are to be the nearest, but to what is not said."""
    most = phrase.superlative
    return most is not None and most.measure == "distance" and most.to is None


def _carries(place: Place) -> bool:
    return place.names[0].role("thing", "object") is not None
