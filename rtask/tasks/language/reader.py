"""Goals in words, such as ``every cup into the left box``, as patterns.

No model takes part: names, labels and kinds are looked up as for questions in words, and every
word has to fit where it stands, so that nothing is passed over in silence.
"""

from __future__ import annotations

import datetime
import difflib
from collections.abc import Sequence
from dataclasses import dataclass, replace

from rtask.errors import UnknownTermError, UsageError
from rtask.rdf.namespaces import PREFIXES
from rtask.tasks.actions import Select
from rtask.tasks.goals import MAX_TEXT, Aim
from rtask.tasks.language.aims import STAYS, aims_of, holds
from rtask.tasks.language.grammar.sentences import Reading, readings
from rtask.tasks.language.items import Items, read_items
from rtask.tasks.language.lexicon import ADJECTIVES, CLASSES, GRASP, NUMBERS, PUT, expanded
from rtask.tasks.language.meaning import Condition
from rtask.tasks.language.slips import MAX_SLIPS, mistyped
from rtask.tasks.language.slots.proposals import Proposal, propose
from rtask.tasks.language.times import deadline_in

__all__ = ["MAX_TEXT", "Understood", "read_goal"]

_MAX_NAMES = 500
_MAX_COMPARED = 12
_AT_PLACES = (
    "a goal brings things to places that have a name, into hands, and away from places: say 'the "
    "pen where the jug is' for the same place, and 'the cup nearest to the jug' for one of several"
)
_BEYOND = {
    **dict.fromkeys(
        ("next to", "beside", "between", "near", "behind", "in front of", "left of", "right of",
         "alongside", "underneath"), _AT_PLACES),
    **dict.fromkeys(
        ("nearest", "closest", "farthest", "furthest"),
        "to what is not said, or not where it is understood: say 'the cup nearest to panda-1 into "
        "the left box', with a thing, robot or place by its name"),
    **dict.fromkeys(
        ("my", "your", "his", "her", "their", "mine", "yours"),
        "whose a thing is the graph does not say: name it, or say what it is like"),
    **dict.fromkeys(
        ("without", "do not", "never", "avoid"),
        "what may not be done is no goal, as robots move what is in their way: say how things are "
        "to be in the end, such as 'leave the jug where it is' or 'no cup may stay on the table'"),
    **dict.fromkeys(
        ("carefully", "gently", "slowly", "quickly", "fast", "quietly", "straight"),
        "how a robot moves is no part of a goal: leave it out"),
}  # fmt: skip
"""Words that no goal has, with what to say instead."""
_VOCABULARY = frozenset().union(*CLASSES.values(), PUT, GRASP, ADJECTIVES, NUMBERS)


_Meaning = tuple[frozenset[tuple[str, ...]], int | None, int, bool, bool]
"""What fits a goal, for how many, its stage, whether about the rest, and whether it is to stay."""


@dataclass(frozen=True)
class Understood:
    """What a sentence asks for.

    Parameters
    ----------
    aims
        Its goals; empty where its condition does not hold, or what it says of a number does.
    remarks
        What was found of its conditions, in words.
    deadline
        By when, if it says so.
    """

    aims: tuple[Aim, ...]
    remarks: tuple[str, ...] = ()
    deadline: datetime.datetime | None = None


def read_goal(
    select: Select, text: str, base: str = "", now: datetime.datetime | None = None
) -> Understood:
    """Return the goals of a sentence.

    Parameters
    ----------
    select
        Evaluates the look-ups.
    base
        What ``kb:`` stands for; empty where that is not known.
    now
        What "within five minutes" counts from; by default the clock.

    Raises
    ------
    UsageError
        The text is empty or too long, no goal can be read in it, or several that differ; the
        message says what was understood.
    UnknownTermError
        A word means nothing here; the message has the nearest names.
    """
    if not text.strip() or len(text) > MAX_TEXT:
        raise UsageError(f"a goal has 1 to {MAX_TEXT} characters, not {len(text)}")
    plain, deadline = deadline_in(text, now or datetime.datetime.now(datetime.UTC))
    plain = expanded(plain)
    try:
        understood = _read(select, plain, base, MAX_SLIPS)
    except (UsageError, UnknownTermError) as error:
        understood = _second_reading(select, plain, base, deadline is not None, error)
    return replace(understood, deadline=deadline)


def _second_reading(
    select: Select, text: str, base: str, has_deadline: bool, error: UsageError | UnknownTermError
) -> Understood:
    """Return what a refused sentence says if each of its words is accounted for.

    Raises
    ------
    UsageError, UnknownTermError
        It does not, with ``proposals`` in the details if a sentence that is understood is near.
    """
    items = read_items(select, text, base)
    proposal = None if readings(items) else propose(items)
    if proposal is None:
        raise error
    try:
        understood = _read(select, proposal.sentence, base, 0)
    except (UsageError, UnknownTermError):
        raise error from None
    if not proposal.is_certain:
        if has_deadline:
            proposal = replace(proposal, left_out=(*proposal.left_out, "by when"))
        raise _with_proposal(error, proposal, understood)
    remark = f"read as {proposal.sentence!r}"
    return replace(understood, remarks=(remark, *understood.remarks))


def _with_proposal(
    error: UsageError | UnknownTermError, proposal: Proposal, understood: Understood
) -> UsageError | UnknownTermError:
    """Return an error that says what a sentence can have meant."""
    proposed = {
        "sentence": proposal.sentence,
        "left_out": list(proposal.left_out),
        "guessed": list(proposal.guessed),
        "understood": [aim.text for aim in understood.aims],
    }
    return type(error)(f"{error}. Did you mean {proposal.text}?",
                       **{**error.details, "proposals": [proposed]})  # fmt: skip


def _read(select: Select, text: str, base: str, slips: int) -> Understood:
    """Return what a text says, with at most so many words that are mistyped.

    Raises
    ------
    UsageError
        No goal can be read in it, or several that differ.
    UnknownTermError
        A word means nothing here.
    """
    items = read_items(select, text, base)
    ways = readings(items)
    if not ways:
        names = _names(select)
        slip = mistyped(items, names) if slips else None
        if slip is not None:
            try:
                understood = _read(select, slip.corrected(text), base, slips - 1)
            except UsageError as error:
                # What is doubtful of the corrected sentence helps more than the slip itself.
                raise type(error)(f"{slip.remark}; {error}") from None
            return replace(understood, remarks=(slip.remark, *understood.remarks))
        raise _not_understood(items, names)
    matches: dict[frozenset[_Meaning], Understood] = {}
    void: dict[frozenset[_Meaning], Understood] = {}
    torn: dict[frozenset[_Meaning], Understood] = {}
    errors: list[UsageError] = []
    for way in ways[:_MAX_COMPARED]:
        try:
            understood = _understood(select, way)
        except UsageError as error:
            errors.append(error)
            continue
        meaning = _meaning(select, understood)
        if _is_torn(meaning):
            torn.setdefault(meaning, understood)
            continue
        # What stays as it is adds nothing to what is to be done.
        meaning = frozenset(item for item in meaning if not item[-1])
        # Nobody speaks of "the cups on the shelf" where none is there, if it can mean else.
        is_void = any(not ways for ways, *_ in meaning)
        (void if is_void else matches).setdefault(meaning, understood)
    matches = matches or void or torn
    if not matches:
        raise errors[0]
    if len(matches) > 1 or errors or len(ways) > _MAX_COMPARED:
        raise _ambiguous(text, list(matches.values()), errors)
    return next(iter(matches.values()))


def _understood(select: Select, way: Reading) -> Understood:
    aims: list[Aim] = []
    remarks: dict[str, None] = {}
    for deed, conditions in way.deeds:
        unmet = [text for item, is_due in conditions if (text := _unmet(select, item, is_due))]
        if unmet:
            remarks.update(dict.fromkeys(unmet))
            continue
        of_deed = list(aims_of(select, deed))
        if not of_deed:
            remarks[f"{deed.phrase.text}: there are not more"] = None
        aims += of_deed
    return Understood(tuple(aims), tuple(remarks))


def _unmet(select: Select, condition: Condition, is_due: bool) -> str:
    """Return why a condition forbids a goal; "" if it does not."""
    is_so = holds(select, condition)
    if is_so == is_due:
        return ""
    about = condition.place if condition.phrase is None else condition.phrase
    assert about is not None
    return f"nothing is to be done now, as the condition about {about.text} " + (
        "does not hold" if is_due else "holds"
    )


def _meaning(select: Select, understood: Understood) -> frozenset[_Meaning]:
    """Return what a way of reading comes to in the world as it is."""
    meanings = []
    for aim in understood.aims:
        rows = select(f"{PREFIXES}{aim.sparql}")
        ways = frozenset(tuple(str(row[name]) for name in aim.variables) for row in rows)
        number = None if aim.number is not None and _takes_all(aim, ways) else aim.number
        meanings.append((ways, number, aim.stage, aim.others, aim.text.endswith(STAYS)))
    return frozenset(meanings)


def _is_torn(meaning: frozenset[_Meaning]) -> bool:
    """Return whether what is to stay where it is would be taken elsewhere as well."""
    staying = {way for ways, *_, others, is_staying in meaning if is_staying and not others
               for way in ways}  # fmt: skip
    for ways, number, *_, is_staying in meaning:
        if is_staying or number is not None:
            continue
        moved = {way[0] for way in ways}
        if any(way[0] in moved and way not in ways for way in staying):
            return True
    return False


def _takes_all(aim: Aim, ways: frozenset[tuple[str, ...]]) -> bool:
    return len({way[0] for way in ways}) == aim.number


def _ambiguous(
    text: str, matches: Sequence[Understood], errors: Sequence[UsageError]
) -> UsageError:
    ways = [" and ".join(aim.text for aim in way.aims) or "nothing to do" for way in matches]
    ways += [str(error) for error in errors]
    listed = "; or ".join(dict.fromkeys(ways[:4]))
    return UsageError(
        f"{text!r} can be read in several ways, which are not the same here: {listed}"
    )


def _names(select: Select) -> set[str]:
    """Return names of things, places and robots, and of kinds of things."""
    rows = select(
        f"{PREFIXES}SELECT DISTINCT ?name WHERE {{ {{ ?x rt:name ?name . "
        "{ ?x a rt:ManipulableObject } UNION { ?x a rt:SupportSurface } UNION { ?x a cora:Robot } "
        "} UNION { ?k rdfs:subClassOf+ rt:ManipulableObject ; rdfs:label ?name } } "
        f"LIMIT {_MAX_NAMES}"
    )
    return {str(row.value("name")) for row in rows}


def _not_understood(items: Items, names: set[str]) -> UsageError | UnknownTermError:
    at = min(items.furthest, len(items) - 1)
    word = items.word(at)
    listed = _listed(items)
    spoken = f" {' '.join(items.words)} "
    beyond = next((words for words in _BEYOND if f" {words} " in spoken), "")
    if beyond:
        return UsageError(f"{beyond!r}: {_BEYOND[beyond]}; understood: {listed}")
    if items.furthest >= len(items):
        return UsageError(
            f"{items.text(0, len(items))!r} does not say where to, or not clearly; understood: "
            f"{listed}; a goal is such as 'every cup into the left box'"
        )
    covered = {at for name in items.named
               for at in range(name.mentions[0].start, name.mentions[0].end)}  # fmt: skip
    if at in covered or word in _VOCABULARY or not word.isalpha():
        robots = [name for name in items.named if name.role("robot") is not None]
        is_after_robot = any(m.start <= at <= m.end for name in robots for m in name.mentions)
        advice = "; which robot does it, the plan chooses: leave it out" if is_after_robot else ""
        return UsageError(
            f"{word!r} after {items.text(0, at)!r} is not understood where it stands; understood: "
            f"{listed}{advice}"
        )
    near = difflib.get_close_matches(word, sorted(names), n=3, cutoff=0.5)
    hint = f"; the nearest names are {', '.join(near)}" if near else ""
    return UnknownTermError(
        f"{word!r} means nothing here in a goal and is no name in the graph{hint}; understood: "
        f"{listed}"
    )


def _listed(items: Items) -> str:
    named = [f"{m.text!r} ({m.role})" for name in items.named for m in name.mentions]
    return ", ".join(dict.fromkeys(named)) or "nothing"
