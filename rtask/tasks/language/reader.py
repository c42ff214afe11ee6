"""Goals in words, such as ``every cup into the left box``, as patterns.

No model takes part: names, labels and kinds are looked up as for questions in words, and every
word has to fit where it stands, so that nothing is passed over in silence.
"""

from __future__ import annotations

import datetime
import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from rtask.errors import UnknownTermError, UsageError
from rtask.rdf.namespaces import PREFIXES
from rtask.tasks.actions import Select
from rtask.tasks.goals import MAX_TEXT, NO_LIMITS, Aim
from rtask.tasks.language.aims import STAYS, aims_of, holds
from rtask.tasks.language.grammar.sentences import Reading, readings
from rtask.tasks.language.items import read_items
from rtask.tasks.language.lexicon import expanded
from rtask.tasks.language.limiting import OnlyUnclear, limits_of, only_limits
from rtask.tasks.language.meaning import Condition, Deed
from rtask.tasks.language.refusing import names_in, not_understood, why_void
from rtask.tasks.language.slips import MAX_SLIPS, mistyped
from rtask.tasks.language.slots.proposals import Proposal, propose
from rtask.tasks.language.times import deadline_in
from rtask.tasks.language.workers import worker_in
from rtask.tasks.limits import Limits

__all__ = ["MAX_TEXT", "Understood", "read_goal"]

_MAX_COMPARED = 12
_LIMIT_STAGE = -1
_ONLY = r"\b(?:only|just|exclusively|solely)\b"
_NOT_NONE = "what nobody has stated may be so all the same"


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
    limits
        Who alone is to do it or may not, and what may not be touched.
    """

    aims: tuple[Aim, ...]
    remarks: tuple[str, ...] = ()
    deadline: datetime.datetime | None = None
    limits: Limits = NO_LIMITS


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
    worker = worker_in(select, plain)
    if worker is not None:
        # No second reading: its proposals would leave out who is to do it.
        understood = _read(select, worker.deed, base, MAX_SLIPS)
        return replace(
            understood, deadline=deadline, limits=understood.limits | Limits(by=(worker.iri,))
        )
    try:
        understood = _read(select, plain, base, MAX_SLIPS)
    except OnlyUnclear as error:
        raise _without_only(select, plain, base, error) from None
    except (UsageError, UnknownTermError) as error:
        understood = _second_reading(select, plain, base, deadline is not None, error)
    return replace(understood, deadline=deadline)


def _without_only(select: Select, text: str, base: str, error: UsageError) -> Exception:
    """Return an error with what a sentence says without "only", if that can be understood."""
    if re.search(r"\b(?:contain|hold|have|may|can|could|allowed|permitted)s?\b", text, re.I):
        return error  # how a place is to be: to leave out "only" would turn that around
    left_out = re.findall(_ONLY, text, re.I)
    sentence = " ".join(re.sub(_ONLY, " ", text, flags=re.I).split())
    try:
        understood = _read(select, sentence, base, 0)
    except (UsageError, UnknownTermError):
        return error
    return _with_proposal(error, Proposal(sentence, tuple(left_out)), understood)


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
        names = names_in(select)
        slip = mistyped(items, names) if slips else None
        if slip is not None:
            try:
                understood = _read(select, slip.corrected(text), base, slips - 1)
            except (UsageError, UnknownTermError) as error:
                # What is doubtful of the corrected sentence helps more than the slip itself.
                raise type(error)(f"{slip.remark}; {error}") from None
            return replace(understood, remarks=(slip.remark, *understood.remarks))
        raise not_understood(select, items, names)
    matches: dict[frozenset[_Meaning], Understood] = {}
    void: dict[frozenset[_Meaning], Understood] = {}
    empty: list[Reading] = []
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
        ways_so_far = void if is_void else matches
        same = ways_so_far.get(meaning)
        # Of two ways to say the same, the one with less beside it is shown and stored.
        if same is None or len(understood.aims) < len(same.aims):
            ways_so_far[meaning] = understood
        empty += [way] if is_void else []
    matches = _strictest(matches)
    if matches:  # "just" is courtesy then
        errors = [error for error in errors if not isinstance(error, OnlyUnclear)]
    if len(void) == 1 and not matches and not errors:
        # All of these come to the same, so that the first one says what all of them lack.
        reasons = _lacking(select, empty[0])
        if reasons:
            raise UnknownTermError(f"{'; '.join(reasons)}; {_NOT_NONE}")
    matches = matches or void or torn
    if not matches:
        raise next((e for e in errors if not isinstance(e, OnlyUnclear)), errors[0])
    if len(matches) > 1 or errors or len(ways) > _MAX_COMPARED:
        raise _ambiguous(text, list(matches.values()), errors)
    return next(iter(matches.values()))


def _understood(select: Select, way: Reading) -> Understood:
    aims: list[Aim] = []
    remarks: dict[str, None] = {}
    limiting: list[Deed] = []
    limits = Limits()
    for deed, conditions in way.deeds:
        unmet = _unmet_of(select, conditions)
        if unmet:
            remarks.update(dict.fromkeys(unmet))
            continue
        if deed.is_limit or _is_else(deed):
            limiting.append(deed)
            continue
        of_deed = list(aims_of(select, deed))
        if not of_deed:
            remarks[f"{deed.phrase.text}: there are not more"] = None
        aims += of_deed
        limits |= only_limits(select, deed, of_deed)
    limits |= limits_of(select, limiting, aims)
    return Understood(tuple(aims), tuple(remarks), limits=limits)


def _is_else(deed: Deed) -> bool:
    """Return whether a deed says that nothing else is to be touched: "the rest stays there"."""
    phrase = deed.phrase
    return deed.kind == "stay" and phrase.others and phrase.is_generic and not (
        phrase.heads or phrase.places or phrase.is_described or phrase.left_out
    )  # fmt: skip


def _lacking(select: Select, way: Reading) -> list[str]:
    """Return what a way of reading speaks of and the graph does not know; empty if that is hard."""
    deeds = [
        deed for deed, conditions in way.deeds
        if not deed.is_limit and not _unmet_of(select, conditions)
    ]  # fmt: skip
    try:
        return list(dict.fromkeys(why_void(select, deeds)))
    except UsageError:  # of more things than are looked at, it is not said where they are
        return []


def _unmet_of(select: Select, conditions: Sequence[tuple[Condition, bool]]) -> list[str]:
    return [text for item, is_due in conditions if (text := _unmet(select, item, is_due))]


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
    if understood.limits:
        written = json.dumps(understood.limits.to_dict(), sort_keys=True)
        meanings.append((frozenset([(written,)]), None, _LIMIT_STAGE, False, False))
    return frozenset(meanings)


def _strictest(
    matches: Mapping[frozenset[_Meaning], Understood],
) -> dict[frozenset[_Meaning], Understood]:
    """Return ways of reading, of those that differ in their limits alone one that keeps to all.

    In "put just the pens away" a word may be courtesy or a limit: who keeps to it does both.
    """
    goals: dict[frozenset[_Meaning], tuple[frozenset[_Meaning], Understood]] = {}
    for way, read in matches.items():
        bare = frozenset(item for item in way if item[2] != _LIMIT_STAGE)
        if bare in goals:
            earlier, merged = goals[bare]
            both = replace(merged, limits=merged.limits | read.limits)
            goals[bare] = (way if read.limits else earlier), both
        else:
            goals[bare] = way, read
    return dict(goals.values())


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
