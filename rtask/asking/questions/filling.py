"""Queries of the ontology's questions with their slots filled."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass

import ontology
from rtask.asking.questions.catalogue import Question, Slot
from rtask.asking.questions.mentions import Mention
from rtask.asking.questions.periods import Period
from rtask.rdf.terms import Term

__all__ = [
    "Filled",
    "by_role",
    "fill",
    "filled_query",
    "projected",
    "single_things",
    "unused_mentions",
    "with_prefixes",
    "without_order",
]

_KINDS = {"kind": "rt:ManipulableObject", "robot_kind": "cora:Robot"}
_INDIVIDUALS = frozenset(
    ["object", "robot", "place", "task", "grasp", "frame", "recognition", "cloud", "hand"]
)
_PREFIX = re.compile(r"^PREFIX\s+([\w.-]*):\s*<[^>]*>\s*\n", re.M)
_LIMIT = re.compile(r"\bLIMIT\s+\d+\s*$")
_ORDER = re.compile(r"^ORDER BY .*$", re.M)


@dataclass(frozen=True)
class Filled:
    """A slot with what fills it.

    Parameters
    ----------
    slot
        The slot.
    text
        The words that name it.
    terms
        What they name; a kind restricts to its instances.
    is_kind
        The terms are classes of what the slot takes.
    period
        For a slot of role ``time``.
    called
        With a kind: objects that are called so, of whatever class.
    """

    slot: Slot
    text: str
    terms: tuple[Term, ...] = ()
    is_kind: bool = False
    period: Period | None = None
    called: tuple[Term, ...] = ()


def fill(question: Question, mentions: Iterable[Mention], period: Period | None) -> list[Filled]:
    """Return the slots of a question that what was named fills, each at most once."""
    filled: list[Filled] = []
    used: set[tuple[int, int]] = set()
    # Words of the question itself name nothing, even where a thing is called so.
    named = [item for item in mentions if not _is_own(question, item)]
    for slot in question.slots:
        if slot.role == "time":
            if period is not None:
                filled.append(Filled(slot, period.text, period=period))
            continue
        choices = [
            item for item in named if (item.start, item.end) not in used and _fits(slot, item)
        ]
        if not choices:
            continue
        mention = min(choices, key=lambda item: _preference(slot, item))
        # Each name fills one slot: "between cup 1 and cup 2" has two.
        used.add((mention.start, mention.end))
        is_kind = (mention.role == "kind" and slot.role == "object") or _restricts(slot, mention)
        filled.append(Filled(slot, mention.text, mention.terms, is_kind, called=mention.called))
    return filled


def by_role(filled: Iterable[Filled]) -> dict[str, tuple[str, tuple[str, ...]]]:
    """Return words and terms by role; the second robot of a question is ``robot 2``."""
    result: dict[str, tuple[str, tuple[str, ...]]] = {}
    for item in filled:
        role, number = item.slot.role, 2
        while role in result:
            role, number = f"{item.slot.role} {number}", number + 1
        result[role] = (item.text, tuple(map(str, item.terms)))
    return result


def single_things(filled: Iterable[Filled]) -> dict[str, str]:
    """Return the IRI of each slot that one thing fills, by role; none for a role filled twice."""
    filled = list(filled)
    roles = [item.slot.role for item in filled]
    return {
        item.slot.role: str(item.terms[0]).strip("<>")
        for item in filled
        if len(item.terms) == 1 and not item.is_kind and roles.count(item.slot.role) == 1
    }


def unused_mentions(
    question: Question, filled: Iterable[Filled], mentions: Iterable[Mention]
) -> list[str]:
    """Return the names for which a question has no place."""
    used = {item.text for item in filled}
    unused = [
        item.text for item in mentions if item.text not in used and not _is_own(question, item)
    ]
    return list(dict.fromkeys(unused))


def individual(unused: Iterable[str], mentions: Iterable[Mention]) -> str:
    """Return a name, of a single thing or robot, for which the question has no place; or nothing.

    A kind without a place makes an answer wider; a name without one makes it one about others.
    """
    mentions = list(mentions)
    # A name that may also be a kind's leaves the question as it is.
    individuals = {item.text for item in mentions if item.role in _INDIVIDUALS}
    kinds = {item.text for item in mentions if item.role not in _INDIVIDUALS}
    return next((name for name in unused if name in individuals - kinds), "")


def _is_own(question: Question, mention: Mention) -> bool:
    """Return whether a name is rather a word of the question, as "box" in "dropped on the way"."""
    if mention.role not in ("kind", "robot_kind"):
        return False
    own = question.own_words
    return len(mention.text.split()) == 1 and mention.text.lower() in own


def _restricts(slot: Slot, mention: Mention) -> bool:
    return slot.role == "kind" and not slot.is_constant and mention.role == "kind"


def _fits(slot: Slot, mention: Mention) -> bool:
    return mention.role == slot.role or (slot.role == "object" and mention.role == "kind")


def _preference(slot: Slot, mention: Mention) -> tuple[bool, bool, int]:
    """Prefer an object to its kind, unless the words are a plural; then the first."""
    is_kind = mention.role == "kind"
    return mention.is_plural and not is_kind, mention.role != slot.role, mention.start


def filled_query(question: Question, filled: Iterable[Filled]) -> str:
    """Return the query of a question with its slots filled.

    A constant that nothing fills becomes a variable, so that the answer is about all; a class
    becomes the most general one.
    """
    text = question.sparql
    by_slot = {item.slot: item for item in filled}
    added: list[str] = []
    for slot in question.slots:
        item = by_slot.get(slot)
        if slot.is_list:
            text = _with_values(text, slot, item)
        elif slot.is_constant:
            text, pattern = _with_constant(text, slot, item)
            added += pattern
        elif item is not None:
            added.append(_restriction(item))
    if added:
        # Before the last brace: the query's own patterns come first, and bind what is restricted.
        end = text.rindex("}")
        text = text[:end].rstrip() + "\n" + "".join(f"  {item}\n" for item in added) + text[end:]
    return with_prefixes(text)


def _with_values(text: str, slot: Slot, item: Filled | None) -> str:
    clause = re.compile(rf"[ \t]*VALUES\s+{re.escape(slot.term)}\s*{{[^}}]*}}\s*\n")
    if item is None:
        return clause.sub("", text)
    # As a function, since a backslash in a name would be read as a reference.
    members = " ".join(str(term) for term in item.terms)
    return clause.sub(lambda _: f"  VALUES {slot.term} {{ {members} }}\n", text)


def _with_constant(text: str, slot: Slot, item: Filled | None) -> tuple[str, list[str]]:
    """Return a query with its constant replaced, and patterns to add."""
    if item is not None and len(item.terms) == 1 and not item.is_kind:
        return _replaced(text, slot, str(item.terms[0])), []
    if item is None and slot.role in _KINDS:
        return text, []
    # The query may use that name for something else.
    variable = f"?{slot.role}" if f"?{slot.role} " not in text else f"?the_{slot.role}"
    text = projected(_replaced(text, slot, variable), variable)
    if item is None:
        return text, []
    terms = " ".join(str(term) for term in item.terms)
    if not item.is_kind:
        return text, [f"VALUES {variable} {{ {terms} }}"]
    return text, [_instances(variable, item)]


def _replaced(text: str, slot: Slot, by: str) -> str:
    constant = re.compile(rf"(?<![\w:?<]){re.escape(slot.term)}(?![\w-])")
    return constant.sub(lambda _: by, text)


def projected(text: str, variable: str) -> str:
    """Add a variable to the outermost SELECT and GROUP BY, so that all its values have rows."""
    text = re.sub(r"^SELECT (DISTINCT )?", rf"SELECT \g<1>{variable} ", text, count=1, flags=re.M)
    end = text.rindex("}")
    head, tail = text[:end], text[end:]
    tail = re.sub(r"GROUP BY ", f"GROUP BY {variable} ", tail)
    # A limit was meant for one thing; of several each is to have its rows.
    return head + _LIMIT.sub("", tail.rstrip()).rstrip() + "\n"


def without_order(text: str) -> str:
    """Return a query without the order of its rows, which those who count them do not need."""
    end = text.rindex("}")
    return text[:end] + _ORDER.sub("", text[end:]).rstrip() + "\n"


def _restriction(item: Filled) -> str:
    """Return the pattern that restricts a variable to what was named."""
    variable, pattern = item.slot.term, item.slot.pattern
    if item.period is not None:
        begin, _, end = variable.partition("/")
        if end:
            # A span of time is met by whatever overlaps it, a moment by what lies in it.
            return f"FILTER({item.period.overlap(begin, end)})"
        inner = f"{pattern} FILTER({item.period.condition(variable)})"
        return f"FILTER EXISTS {{ {inner} }}" if pattern else inner.strip()
    if item.is_kind:
        inner = _instances(variable, item)
    elif len(item.terms) == 1 and pattern:
        name, term = re.compile(re.escape(variable) + r"(?!\w)"), str(item.terms[0])
        return f"FILTER EXISTS {{ {name.sub(lambda _: term, pattern)} }}"
    else:
        inner = f"VALUES {variable} {{ {' '.join(str(term) for term in item.terms)} }}"
    return f"FILTER EXISTS {{ {pattern} . {inner} }}" if pattern else inner


def _instances(variable: str, item: Filled) -> str:
    """Return the pattern for the instances of kinds, and for what is called so."""
    if item.called:
        kinds = " UNION ".join(f"{{ {variable} a {term} }}" for term in item.terms)
        called = " ".join(str(term) for term in item.called)
        either = f"{kinds} UNION {{ VALUES {variable} {{ {called} }} }}"
        # Both may name the same thing, which is to come once.
        return f"{{ SELECT DISTINCT {variable} {{ {either} }} }}"
    if len(item.terms) == 1:
        return f"{{ {variable} a {item.terms[0]} }}"
    kinds = " ".join(str(term) for term in item.terms)
    return f"FILTER EXISTS {{ VALUES ?kind {{ {kinds} }} {variable} a ?kind }}"


def with_prefixes(text: str) -> str:
    """Return a query with the prefixes that it uses, and no other."""
    body = _PREFIX.sub("", text).lstrip()
    declared = dict(ontology.PREFIXES)
    for line in _PREFIX.finditer(text):
        declared[line[1]] = line[0].partition("<")[2].partition(">")[0]
    # A colon inside a text or an IRI is no prefix.
    bare = re.sub(r"<[^>\s]*>|\"[^\"\n]*\"", " ", body)
    used = {match[1] for match in re.finditer(r"(?<![\w?$])([\w-]*):[\w]", bare)}
    used |= {match[1] for match in re.finditer(r"\^\^([\w-]*):", body)}
    head = "".join(f"PREFIX {name}: <{declared[name]}>\n" for name in declared if name in used)
    return f"{head}\n{body}"
