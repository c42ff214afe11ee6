"""Goals in words, such as ``every cup into the left box``, as patterns.

No model takes part: names, labels and kinds are looked up as for questions in words, and every
other word must be one of those that goals are made of, so that nothing is passed over in silence.
"""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

from rtask.asking.questions.mentions import (
    MAX_MENTIONS,
    Mention,
    find_mentions,
    tokens_of,
    with_called,
)
from rtask.errors import UnknownTermError, UsageError
from rtask.rdf.namespaces import PREFIXES
from rtask.tasks.actions import Select
from rtask.tasks.clauses import (
    Clause,
    Name,
    NounPhrase,
    is_familiar,
    is_verb,
    listed,
    read_clause,
)
from rtask.tasks.goals import LOCATED, Aim
from rtask.tasks.phrasing import EXCEPT, plain_goal

__all__ = ["MAX_TEXT", "aims_in_words"]

MAX_TEXT = 1000
_ROLES = {
    "object": "rt:ManipulableObject", "thing": "rt:Exemplar", "robot": "cora:Robot",
    "place": "rt:SupportSurface", "use": "rt:ObjectFunction", "colour": "rt:Colour",
}  # fmt: skip
_KINDS = {"kind": "rt:ManipulableObject"}
_HOLDS, _CLEAR = ("grasp", "take"), ("empty", "clear")
_IN_ORDER = "then"
_SEPARATORS = frozenset(("and", _IN_ORDER))
_MAX_NAMES = 500


@dataclass(frozen=True)
class _Part:
    """A stretch of a goal: its words, what they name, and how many "then" stand before it."""

    tokens: tuple[str, ...]
    mentions: tuple[Mention, ...]
    stage: int = 0

    def words(self) -> Iterator[str]:
        """Yield the words that belong to no name."""
        covered = {at for item in self.mentions for at in range(item.start, item.end)}
        return (token.lower() for at, token in enumerate(self.tokens) if at not in covered)


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
    for part in parts:
        for word in part.words():
            if not is_familiar(word):
                raise _unknown(select, word, parts)
    clauses = _completed([read_clause(part.tokens, part.mentions) for part in parts])
    aims = []
    for part, clause in zip(parts, clauses, strict=True):
        if not _has_end(clause) and clause.verb not in _HOLDS:
            raise UsageError(
                f"{clause.text!r} does not say where to; understood: {listed(part.mentions)}; "
                "a goal is such as 'every cup into the left box'"
            )
        aim = _aim(clause)
        later = f"{_IN_ORDER} " * bool(part.stage)
        aims.append(replace(aim, stage=part.stage, text=later + aim.text))
    return tuple(aims)


def _completed(clauses: list[Clause]) -> list[Clause]:
    """Return clauses of which those without an end of their own have that of their neighbours.

    "the cups and the pens from the table into the box" has the table and the box for both. A clause
    that begins with a verb of its own is another sentence, and lends nothing to those before it.
    """
    for before, clause in pairwise(clauses):
        if not clause.verb and not _has_end(before):
            clause.verb = before.verb
            clause.removes |= _is_removal(clause)
            clause.is_continued = True
    for clause, after in zip(clauses[-2::-1], clauses[:0:-1], strict=False):
        if clause.subject.has_bare_colour and after.is_continued:  # "the red and the blue cups"
            clause.subject.heads = after.subject.heads
            clause.subject.is_generic = after.subject.is_generic
            clause.subject.is_plural = after.subject.is_plural
        if not _has_end(clause) and after.is_continued and _has_end(after):
            clause.target, clause.owner, clause.removes = after.target, after.owner, after.removes
            clause.goes_back = after.goes_back
            clause.subject.sources = clause.subject.sources or after.subject.sources
            clause.left_out = [*clause.left_out, *after.left_out]
    for before, clause in pairwise(clauses):
        is_bare = not (clause.verb or clause.subject.sources or clause.left_out)
        if is_bare and not _has_end(clause) and not before.removes:
            clause.target, clause.owner = before.target, before.owner
    return clauses


def _has_end(clause: Clause) -> bool:
    return clause.target is not None or clause.removes or clause.goes_back


def _is_removal(clause: Clause) -> bool:
    return clause.verb == "remove" and clause.target is None and bool(clause.subject.sources)


def _parts(select: Select, text: str, base: str) -> Iterator[_Part]:
    stage = 0
    for sentence in _sentences(text):
        tokens = tokens_of(sentence)
        if not tokens:
            continue
        mentions = _only_called(select, with_called(select, tokens, _find(select, tokens, base)))
        if any(item.is_cut for item in mentions):
            raise UsageError(
                f"{sentence.strip()!r} names more than {MAX_MENTIONS} things: give their kind, a "
                "full name in quotes, or an IRI"
            )
        covered = {at for item in mentions for at in range(item.start, item.end)}
        start = 0
        for at, token in enumerate([*tokens, "and"]):
            is_end = at == len(tokens)
            if is_end or (at not in covered and _separates(tokens, start, at)):
                if at > start:
                    yield _Part(
                        tuple(tokens[start:at]),
                        tuple(_moved(m, start) for m in mentions if start <= m.start < at),
                        stage,
                    )
                start = at + 1
                stage += token.lower() == _IN_ORDER


def _sentences(text: str) -> Iterator[str]:
    """Yield sentences; the commas of a list of what is left out are read as "and"."""
    parts = re.split(r"([;,.!]\s+|[;,.!]$)", text)
    sentence = parts[0]
    for mark, after in zip(parts[1::2], parts[2::2], strict=True):
        words = tokens_of(after)
        first = words[0].lower() if mark.startswith(",") and words else _IN_ORDER
        goes_on = EXCEPT in tokens_of(sentence) and first != _IN_ORDER and not is_verb(first)
        if goes_on or first == EXCEPT:
            sentence += (" " if first in (EXCEPT, "and") else " and ") + after
        else:
            yield sentence
            sentence = after
    yield sentence


def _separates(tokens: Sequence[str], start: int, at: int) -> bool:
    """Return whether "and" or "then" ends a part; not within a list of what is left out."""
    word = tokens[at].lower()
    if word == _IN_ORDER:
        return True
    begun = [token.lower() for token in tokens[start:at]]
    following = tokens[at + 1].lower() if at + 1 < len(tokens) else ""
    if word != "and" or EXCEPT not in begun:
        return word == "and"
    return is_verb(following) or following == _IN_ORDER


def _find(select: Select, tokens: list[str], base: str) -> list[Mention]:
    # In a goal "can" is what stands on the table: its modals are replaced by now.
    return find_mentions(select, tokens, base, _ROLES, _KINDS, has_modals=False)


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


def _aim(clause: Clause) -> Aim:
    """Return a clause as a goal."""
    subject, target = clause.subject, clause.target
    if target is not None and clause.verb in _CLEAR and not clause.removes:
        return _clearing(clause, target)
    if (subject.is_empty and not subject.sources) or subject.has_bare_colour:
        raise UsageError(f"{clause.text!r} does not say which things are to be there")
    conditions = ["?thing a rt:Exemplar", *_conditions(subject, "subject")]
    conditions += _left_out(clause)
    if clause.removes:
        conditions.append(_elsewhere(subject.sources))
    elif clause.goes_back:
        conditions.append(_EARLIER)
    else:
        if clause.owner is not None:
            conditions.append(f"{_terms('owner', _role(clause.owner, 'robot'))} "
                              "?owner rt:reaches ?place")  # fmt: skip
        conditions.append(_destination(target))
    conditions.append("FILTER NOT EXISTS { ?thing rt:mergedInto ?merged }")
    if not subject.heads:
        conditions.append("?thing rt:locatedOn ?anywhere")
    number, words = clause.quantity or _usual_quantity(subject)
    return Aim(LOCATED, " . ".join(conditions), number, f"{words} {_about(clause)}")


def _left_out(clause: Clause) -> Iterator[str]:
    """Yield the conditions that things are none of those that a goal leaves out."""
    for at, phrase in enumerate(clause.left_out):
        ways = " . ".join(["?thing a rt:Exemplar", *_conditions(phrase, f"left_out{at}_")])
        yield f"MINUS {{ {ways} }}"


def _exceptions(clause: Clause) -> str:
    return "".join(f" except {phrase.text}" for phrase in clause.left_out)


def _about(clause: Clause) -> str:
    """Return what a goal is about, and where that is to be, for people."""
    subject, target = clause.subject, clause.target
    is_any = not (subject.heads or subject.colours or subject.other_colours)
    about = f"{'everything that has a place ' * is_any}{subject.text}"
    called = sum(len(kind.called) for head in subject.heads if (kind := head.role("kind")))
    about = about.strip() + (f" (and {called} only called so)" if called else "")
    about += _exceptions(clause)
    if clause.removes:
        return f"{about}: elsewhere"
    if clause.goes_back:
        return f"{about}: where it was before"
    of = f" of {clause.owner.text}" if clause.owner is not None else ""
    return f"{about}: held" if target is None else f"{about}: at {target.text}{of}"


def _conditions(phrase: NounPhrase, prefix: str) -> Iterator[str]:
    """Yield the conditions that things are what a phrase says."""
    for at, name in enumerate(phrase.heads):
        yield _fitting(name, f"{prefix}{at}")
    for number, name in enumerate(phrase.colours):
        colour = f"{prefix}_colour{number}"
        yield f"{_terms(colour, _role(name, 'colour'))} ?thing rt:exemplarOf/rt:hasColour ?{colour}"
    for number, name in enumerate(phrase.other_colours):
        # Of what nobody has seen the colour of, it is not known that it is not red.
        any_colour, colours = (
            f"{prefix}_any{number}",
            " ".join(map(str, _role(name, "colour").terms)),
        )
        yield (
            f"?thing rt:exemplarOf/rt:hasColour ?{any_colour} . FILTER NOT EXISTS {{ "
            f"VALUES ?not_{any_colour} {{ {colours} }} "
            f"?thing rt:exemplarOf/rt:hasColour ?not_{any_colour} }}"
        )
    for number, name in enumerate(phrase.sources):
        source = f"{prefix}_source{number}"
        yield f"{_terms(source, _role(name, 'place'))} ?thing rt:locatedOn ?{source}"


def _role(name: Name, role: str) -> Mention:
    mention = name.role(role)
    if mention is None:
        raise UsageError(f"{name.text!r} is no {role}")
    return mention


def _fitting(name: Name, variable: str) -> str:
    """Return the condition that things fit a name; where it can mean several, any of these.

    A kind means what is called so as well, as in questions: nobody need have classified carton-6.
    """
    # Groups and MINUS do not see ?thing from outside: each way has to bind it by itself.
    ways = {
        "kind": "?thing rt:exemplarOf/a ?%s", "object": "?thing rt:exemplarOf ?%s",
        "thing": "BIND(?%s AS ?thing)", "use": "?thing rt:exemplarOf/rt:hasFunction ?%s",
    }  # fmt: skip
    fitting = [item for item in name.mentions if item.role in ways]
    parts = [f"{{ {_terms(variable, item)} {ways[item.role] % variable} }}" for item in fitting]
    called = " ".join(str(term) for item in fitting if item.role == "kind" for term in item.called)
    if called:
        parts.append(f"{{ VALUES ?{variable} {{ {called} }} ?thing rt:exemplarOf ?{variable} }}")
    return " UNION ".join(parts)


def _terms(name: str, mention: Mention) -> str:
    return f"VALUES ?{name} {{ {' '.join(map(str, mention.terms))} }}"


def _destination(target: Name | None) -> str:
    if target is None:
        return "?robot a cora:Robot ; rt:hasEndEffector ?place"
    place = target.role("place")
    if place is not None:
        return f"VALUES ?place {{ {' '.join(map(str, place.terms))} }}"
    mention = target.role("robot", "thing", "object")
    assert mention is not None
    terms = _terms("target", mention)
    if mention.role == "robot":
        return f"{terms} ?target rt:hasEndEffector ?place"
    if mention.role == "object":
        return f"{terms} {{ BIND(?target AS ?place) }} UNION {{ ?place rt:exemplarOf ?target }}"
    return f"VALUES ?place {{ {' '.join(map(str, mention.terms))} }}"


def _elsewhere(sources: Sequence[Name]) -> str:
    """Return the condition that a place is one that robots reach, and none of some."""
    terms = [str(term) for name in sources for term in _role(name, "place").terms]
    return f"?robot rt:reaches ?place FILTER(?place NOT IN ({', '.join(terms)}))"


_EARLIER = """?was rt:placementOf ?thing ; rt:placedOn|rt:placedIn ?place ;
  time:hasEnd/time:inXSDDateTimeStamp ?end . ?place a rt:SupportSurface . FILTER NOT EXISTS {
    ?later rt:placementOf ?thing ; rt:placedOn|rt:placedIn ?other ;
      time:hasEnd/time:inXSDDateTimeStamp ?later_end . ?other a rt:SupportSurface
    FILTER(?later_end > ?end) } FILTER NOT EXISTS { ?thing rt:locatedOn ?place }"""
"""That a place is the one where a thing was last, the present one and hands aside."""


def _clearing(clause: Clause, target: Name) -> Aim:
    """Return the goal that nothing, or nothing of a kind, is at a place any more."""
    place = _role(target, "place")
    owner = ""
    if clause.owner is not None:
        owner = f"{_terms('owner', _role(clause.owner, 'robot'))} ?owner rt:reaches ?source"
    conditions = [
        "?thing a rt:Exemplar", f"{_terms('source', place)} ?thing rt:locatedOn ?source",
        owner, *_conditions(clause.subject, "subject"), *_left_out(clause), _elsewhere([target]),
    ]  # fmt: skip
    what = (clause.subject.text or "everything") + _exceptions(clause)
    where = " . ".join(filter(None, conditions))
    return Aim(LOCATED, where, None, f"{what} at {target.text}: elsewhere")


def _usual_quantity(subject: NounPhrase) -> tuple[int | None, str]:
    """Return for how many things a goal is meant that does not say so.

    The name of a product means all things of it.
    """
    is_kind = any(name.role("kind", "use") for name in subject.heads)
    is_single = is_kind or subject.is_generic
    return (1, "one of:") if is_single and not subject.is_plural else (None, "all:")


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
        f"understood: {listed([item for part in parts for item in part.mentions])}"
    )
