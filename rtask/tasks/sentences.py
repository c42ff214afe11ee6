"""Goals in words, such as ``every cup into the left box``, as patterns.

No model takes part: names, labels and kinds are looked up as for questions in words, and every
other word must be one of those that goals are made of, so that nothing is passed over in silence.
"""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

from rtask.asking.questions.mentions import (
    MAX_MENTIONS,
    Mention,
    find_mentions,
    tokens_of,
    with_called,
)
from rtask.asking.questions.words import stem
from rtask.errors import UnknownTermError, UsageError
from rtask.rdf.namespaces import PREFIXES
from rtask.tasks.actions import Select
from rtask.tasks.goals import LOCATED, Aim
from rtask.tasks.phrasing import EXCEPT, plain_goal

__all__ = ["MAX_TEXT", "aims_in_words"]

MAX_TEXT = 1000
_ROLES = {
    "object": "rt:ManipulableObject", "thing": "rt:Exemplar", "robot": "cora:Robot",
    "place": "rt:SupportSurface", "use": "rt:ObjectFunction",
}  # fmt: skip
_KINDS = {"kind": "rt:ManipulableObject"}
_INTO = frozenset(["into", "in", "onto", "on", "to", "inside", "at"])
_ALL = frozenset(["all", "every", "each", "everything", "both"])
_ANY = frozenset(["a", "an", "any", "some", "something", "anything", "one"])
_NUMBERS = {"two": 2, "three": 3, "four": 4, "five": 5, "six": 6, "seven": 7, "eight": 8, "nine": 9}
_HOLD = frozenset(["hold", "grasp", "grip", "pick", "lift", "take"])
_CLEAR = frozenset(["empty", "clear"])
_FILLERS = frozenset(
    re.findall(
        r"\w+",
        "the of that which who is are be it them up down over please robot move put bring place "
        "get take carry store sort drop lay set pick hold grasp grip lift give hand pass fetch "
        "tidy clean away thing things object objects item items to with for from should must "
        "lies lie stands stand standing lying first only just everything something anything",
    )
)
_OTHERS = frozenset(("off", "my", "our"))
_IN_ORDER = "then"
_SEPARATORS = frozenset(("and", _IN_ORDER))
_LEFT_OUT = frozenset((EXCEPT,))
_MAX_NAMES = 500


@dataclass(frozen=True)
class _Part:
    """A stretch of a goal: its words, what they name, and how many "then" stand before it."""

    tokens: tuple[str, ...]
    mentions: tuple[Mention, ...]
    stage: int = 0

    def words(self) -> Iterator[tuple[int, str]]:
        """Yield the words that belong to no name, with their places."""
        covered = {at for item in self.mentions for at in range(item.start, item.end)}
        for at, token in enumerate(self.tokens):
            if at not in covered:
                yield at, token.lower()

    def leaves_out(self) -> int | None:
        """Return the token from which on things are named that the goal leaves out."""
        return next((at for at, word in self.words() if word in _LEFT_OUT), None)

    def before(self, mention: Mention) -> str:
        """Return the preposition before a name; "" without one."""
        plain = dict(self.words())
        for at in range(mention.start - 1, -1, -1):
            word = plain.get(at, "")
            if word in _INTO or word in ("from", "of", "off"):
                return word
            if word not in ("the", "a", "an", "my", "our", "any"):
                break
        return ""


def aims_in_words(select: Select, text: str, base: str = "") -> tuple[Aim, ...]:
    """Return the goals of a sentence.

    Parameters
    ----------
    select
        Evaluates the look-ups.
    base
        What ``kb:`` stands for; empty where that is not known.

    Raises
    ------
    UsageError
        The text is empty or too long, or no goal can be read in it; the message says what was
        understood.
    UnknownTermError
        A word means nothing here; the message has the nearest names.
    """
    if not text.strip() or len(text) > MAX_TEXT:
        raise UsageError(f"a goal has 1 to {MAX_TEXT} characters, not {len(text)}")
    parts = list(_parts(select, plain_goal(text), base))
    unknown = [
        word for part in parts for _, word in part.words() if not _is_familiar(word)
    ]  # fmt: skip
    if unknown:
        raise _unknown(select, unknown[0], parts)
    targets = [_target(part) for part in parts]
    aims = []
    for at, part in enumerate(parts):
        target = next((item for item in targets[at:] if item is not None), None)
        if target is None and not _has_verb(part, _HOLD):
            raise UsageError(
                f"{' '.join(part.tokens)!r} does not say where to; understood: {_listed([part])}; "
                "a goal is such as 'every cup into the left box'"
            )
        aim = _aim(part, target, targets[at] is not None)
        later = f"{_IN_ORDER} " * bool(part.stage)
        aims.append(replace(aim, stage=part.stage, text=later + aim.text))
    return tuple(aims)


def _parts(select: Select, text: str, base: str) -> Iterator[_Part]:
    stage = 0
    for sentence in re.split(r"[;,.!]\s+|[;,.!]$", text):
        tokens = tokens_of(sentence)
        if not tokens:
            continue
        mentions = _only_called(
            select, with_called(select, tokens, find_mentions(select, tokens, base, _ROLES, _KINDS))
        )
        if any(item.is_cut for item in mentions):
            raise UsageError(
                f"{sentence.strip()!r} names more than {MAX_MENTIONS} things: give their kind, a "
                "full name in quotes, or an IRI"
            )
        covered = {at for item in mentions for at in range(item.start, item.end)}
        start = 0
        for at, token in enumerate([*tokens, "and"]):
            if at == len(tokens) or (token.lower() in _SEPARATORS and at not in covered):
                if at > start:
                    yield _Part(
                        tuple(tokens[start:at]),
                        tuple(_moved(m, start) for m in mentions if start <= m.start < at),
                        stage,
                    )
                start = at + 1
                stage += token.lower() == _IN_ORDER


def _only_called(select: Select, mentions: Iterable[Mention]) -> list[Mention]:
    """Return mentions without those things that are of the kind as well as called so."""
    result = []
    for item in mentions:
        if item.called:
            kinds, called = (" ".join(map(str, terms)) for terms in (item.terms, item.called))
            rows = select(
                f"SELECT ?s WHERE {{ VALUES ?s {{ {called} }} "
                f"FILTER NOT EXISTS {{ VALUES ?kind {{ {kinds} }} ?s a ?kind }} }}"
            )
            strangers = tuple(term for row in rows if (term := row["s"]) is not None)
            item = replace(item, called=strangers)
        result.append(item)
    return result


def _moved(mention: Mention, by: int) -> Mention:
    return replace(mention, start=mention.start - by, end=mention.end - by)


def _is_familiar(word: str) -> bool:
    groups = (_FILLERS, _INTO, _ALL, _ANY, _CLEAR, _HOLD, _OTHERS, _LEFT_OUT)
    is_number = word in _NUMBERS or word.isdigit()
    return is_number or any(word in group or stem(word) in group for group in groups)


def _has_verb(part: _Part, verbs: frozenset[str]) -> bool:
    return any(stem(word) in verbs or word in verbs for _, word in part.words())


def _target(part: _Part) -> Mention | None:
    """Return the name of where things are to be."""
    if _has_verb(part, _CLEAR):
        return next((item for item in part.mentions if item.role == "place"), None)
    named = [item for item in part.mentions if part.before(item) in _INTO]
    for roles in (("place", "robot"), ("thing", "object")):
        of_role = [item for item in named if item.role in roles]
        if of_role:
            return of_role[-1]
    return None


def _aim(part: _Part, target: Mention | None, is_own: bool) -> Aim:
    if _has_verb(part, _CLEAR) and target is not None and is_own:
        return _clearing(target, [item for item in part.mentions if item is not target])
    spans = {(target.start, target.end)} if target is not None and is_own else set()
    subjects, owner, conditions = [], "", ["?thing a rt:Exemplar"]
    left_out, out = part.leaves_out(), list[str]()
    for span in sorted({(item.start, item.end) for item in part.mentions} - spans):
        same = [item for item in part.mentions if (item.start, item.end) == span]
        robots = [item for item in same if item.role == "robot"]
        before = part.before(same[0])
        if left_out is not None and span[0] > left_out and not _is_place(same):
            conditions.append(_without(same, len(out)))
            out.append(same[0].text)
        elif robots and before == "of" and target is not None and span > min(spans, default=span):
            owner = robots[0].text
            conditions.append(f"{_terms('owner', robots[0])} ?owner rt:reaches ?place")
        elif _is_place(same):
            place = next(item for item in same if item.role == "place")
            conditions.append(f"{_terms('source', place)} ?thing rt:locatedOn ?source")
            subjects.append(f"from {place.text}")
        else:
            conditions.append(_subject(same, len(subjects)))
            called = sum(len(item.called) for item in same if item.role == "kind")
            subjects.append(same[0].text + (f" (and {called} only called so)" if called else ""))
    if left_out is not None and not out:
        raise UsageError(f"{' '.join(part.tokens)!r} does not say what is left out, by its name")
    conditions.append(_destination(target))
    conditions.append("FILTER NOT EXISTS { ?thing rt:mergedInto ?merged }")
    number, words = _number(part, spans)
    about = " ".join(subjects) or "everything that has a place"
    about += "".join(f" except {name}" for name in out)
    if not subjects:
        conditions.append("?thing rt:locatedOn ?anywhere")
    where_to = "held" if target is None else f"at {target.text}" + (f" of {owner}" if owner else "")
    return Aim(LOCATED, " . ".join(conditions), number, f"{words} {about}: {where_to}")


def _is_place(same: Iterable[Mention]) -> bool:
    return any(item.role == "place" for item in same)


def _without(same: Sequence[Mention], number: int) -> str:
    """Return the condition that things do not fit a name."""
    return f"MINUS {{ {_subject(same, number, 'left_out')} }}"


def _subject(same: Sequence[Mention], number: int, prefix: str = "subject") -> str:
    """Return the condition that things fit a name; where it can mean several, any of these.

    A kind means what is called so as well, as in questions: nobody need have classified carton-6.
    """
    # Groups and MINUS do not see ?thing from outside: each way has to bind it by itself.
    ways = {
        "kind": "?thing rt:exemplarOf/a ?%s", "object": "?thing rt:exemplarOf ?%s",
        "thing": "BIND(?%s AS ?thing)", "use": "?thing rt:exemplarOf/rt:hasFunction ?%s",
    }  # fmt: skip
    name = f"{prefix}{number}"
    fitting = [item for item in same if item.role in ways]
    if not fitting:
        raise UsageError(f"{same[0].text!r} is a {same[0].role}, and nothing that can be moved")
    parts = [f"{{ {_terms(name, item)} {ways[item.role] % name} }}" for item in fitting]
    called = " ".join(str(term) for item in fitting if item.role == "kind" for term in item.called)
    if called:
        parts.append(f"{{ VALUES ?{name} {{ {called} }} ?thing rt:exemplarOf ?{name} }}")
    return " UNION ".join(parts)


def _terms(name: str, mention: Mention) -> str:
    return f"VALUES ?{name} {{ {' '.join(map(str, mention.terms))} }}"


def _destination(target: Mention | None) -> str:
    if target is None:
        return "?robot a cora:Robot ; rt:hasEndEffector ?place"
    terms = _terms("target", target)
    if target.role == "robot":
        return f"{terms} ?target rt:hasEndEffector ?place"
    if target.role == "object":
        return f"{terms} {{ BIND(?target AS ?place) }} UNION {{ ?place rt:exemplarOf ?target }}"
    return f"VALUES ?place {{ {' '.join(map(str, target.terms))} }}"


def _clearing(target: Mention, others: Sequence[Mention]) -> Aim:
    """Return the goal that nothing is at a place any more.

    Raises
    ------
    UsageError
        Something else than a robot that reaches the place is named.
    """
    robots = [item for item in others if item.role == "robot"]
    if len(robots) < len({(item.start, item.end) for item in others}):
        raise UsageError(f"to clear {target.text!r}, name the place and, if need be, its robot")
    owner = "".join(f"{_terms('owner', item)} ?owner rt:reaches ?source . " for item in robots)
    places = " ".join(map(str, target.terms))
    where = (
        f"VALUES ?source {{ {places} }} {owner}?thing a rt:Exemplar ; rt:locatedOn ?source . "
        f"?robot rt:reaches ?place FILTER(?place NOT IN ({', '.join(map(str, target.terms))}))"
    )
    return Aim(LOCATED, where, None, f"everything at {target.text}: elsewhere")


def _number(part: _Part, target: Iterable[tuple[int, int]]) -> tuple[int | None, str]:
    """Return for how many things a goal is meant, None for all; and the words for that.

    The name of a product without a word for how many means all things of it.
    """
    end = min((start for start, _ in target), default=len(part.tokens))
    words = [word for at, word in part.words() if at < end]
    for word in words:
        if word in _ALL:
            return None, "all:"
        if word.isdigit() and int(word) > 0:
            return int(word), f"{int(word)} of:"
        if word in _NUMBERS:
            return _NUMBERS[word], f"{_NUMBERS[word]} of:"
        if word in _ANY:
            return 1, "one of:"
    if any(item.is_plural for item in part.mentions if item.start < end) or not part.mentions:
        return None, "all:"
    is_kind = any(item.role in ("kind", "use") for item in part.mentions if item.start < end)
    return (1, "one of:") if is_kind else (None, "all:")


def _listed(parts: Iterable[_Part]) -> str:
    named = [f"{item.text!r} ({item.role})" for part in parts for item in part.mentions]
    return ", ".join(dict.fromkeys(named)) or "nothing"


def _unknown(select: Select, word: str, parts: Sequence[_Part]) -> UnknownTermError:
    rows = select(
        f"{PREFIXES}SELECT DISTINCT ?name WHERE {{ {{ ?x rt:name ?name . "
        "{ ?x a rt:ManipulableObject } UNION { ?x a rt:SupportSurface } UNION { ?x a cora:Robot } "
        "} UNION { ?k rdfs:subClassOf+ rt:ManipulableObject ; rdfs:label ?name } } "
        f"LIMIT {_MAX_NAMES}"
    )
    names = {str(row.value("name")) for row in rows}
    near = difflib.get_close_matches(word, sorted(names), n=3, cutoff=0.5)
    hint = f"; the nearest names are {', '.join(near)}" if near else ""
    return UnknownTermError(
        f"{word!r} means nothing in a goal and is no name in the graph{hint}; "
        f"understood: {_listed(parts)}"
    )
