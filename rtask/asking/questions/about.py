"""What something is: the card of a thing or term that a question names, and of the graph itself.

"What is carton-6?", "what does grasp width mean?" and "what can I ask?" are what people ask first,
and none of them is a question of the ontology: the answer is what the graph states of one thing.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import ontology
from rtask.asking.cards import card_of, find_term
from rtask.asking.questions.filling import with_prefixes
from rtask.asking.questions.mentions import Mention, Select
from rtask.asking.questions.sentences import MAX_LISTED, names_of, spoken
from rtask.errors import RtaskError
from rtask.rdf.terms import Literal, NamedNode, Term
from rtask.sparql.results import Solutions

__all__ = ["ABOUT", "MAX_FACTS", "MAX_NOUN", "OVERVIEW", "About", "about", "asks_about"]

ABOUT, OVERVIEW = "about", "overview"
MAX_FACTS = 200
MAX_NOUN = 3
"""Words of what is asked about, beyond which a question says more than a name."""
_SHOWN = 10
_IN_FULL = 3
_START = r"^(?:(?:so|and|ok|okay|hi|hello|hey|please|now|then|can you|could you)\b[,\s]*)*"
_WHAT = re.compile(
    _START + r"(?:what(?:'s|s| is| are| was)|who(?:'s| is)|define|describe|explain|show(?: me)?|"
    r"(?:tell me|say|show me) (?:something |more |all |everything )?(?:about|of)|"
    r"what do (?:you|we) know (?:about|of)|what is known (?:about|of)|"
    r"(?:what is )?(?:the )?(?:meaning|definition) of|what is meant by|"
    r"give me details (?:on|of|about))"
    r"\s+(?P<noun>[^,;]+?)\s*[?.!]*$",
    re.I,
)
_MEANS = re.compile(
    _START
    + r"what (?:do|does|is|are) (?:the )?(?:words?|terms?|property|class)?\s*(?P<noun>[^,;]+?)"
    r" (?:mean|stand for|supposed to mean)\s*[?.!]*$",
    re.I,
)
_ARTICLE = re.compile(r"^(?:an?|the|this|that|our)\s+", re.I)
_GRAPH = re.compile(
    _START
    + r"(?:help|what (?:can|could|may|should) (?:i|we|one) (?:ask|do|say)(?: (?:you|here|it|now))*|"
    r"what(?:'s|s| is) (?:this|rtask|(?:all )?this (?:about|for|here)|going on here)|"
    r"what do you (?:know|have)|what are you|who are you|how does (?:this|it) work|"
    r"(?:show me )?what(?:'s|s| is) in (?:the|this|your) "
    r"(?:graph|store|database|knowledge (?:graph|base)|memory)|"
    r"what (?:data|information|knowledge) (?:do you have|is there|is in (?:the|this) \w+)|"
    r"(?:give me )?an? (?:overview|summary)(?: of (?:this|the graph))?|"
    r"where (?:do|should) i (?:start|begin))"
    r"\s*[?.!]*$",
    re.I,
)
_NUMBERED = re.compile(r"[0-9a-f]{8}-[0-9a-f-]{27}")
"""How nameless things are called, which tells a reader nothing."""
_UNITS = {"M": "m", "KiloGM": "kg", "SEC": "s", "N": "N", "RAD": "rad", "M-PER-SEC": "m/s",
          "N-M": "N m", "PA": "Pa", "PIX": "px", "BYTE": "bytes"}  # fmt: skip
_INDIVIDUAL = {"object", "robot", "task", "grasp", "frame", "recognition", "cloud", "place",
               "colour", "trait", "use"}  # fmt: skip
_OF_BOOKS = ("shortId", "objectId", "name", "graphDigest", "requestId", "seed")
_OVERVIEW = with_prefixes(
    """SELECT ?what (COUNT(DISTINCT ?thing) AS ?count) WHERE {
  VALUES (?class ?what) {
    (cora:Robot "robots") (rt:ManipulableObject "objects") (rt:SupportSurface "places")
    (rt:GraspConfiguration "grasps") (rt:GraspAttempt "attempts to grasp") (rt:Task "tasks")
    (rt:SuccessfulOutcome "that held") (rt:FailedOutcome "that failed")
    (rt:GraspRefusal "refusals") (rt:HiddenCause "hidden causes")
  }
  OPTIONAL { ?thing a ?class FILTER NOT EXISTS { ?thing a rt:Exemplar } }
} GROUP BY ?what"""
)
_FIRST = ("Which robots are there?", "What can each robot grasp?", "Where is each object?")


@dataclass(frozen=True)
class About:
    """What a question of this sort asks about, and its answer.

    Parameters
    ----------
    key
        ``about`` or ``overview``.
    understood
        The question in full.
    filled
        Words and terms of what it names, by role.
    sparql, rows, names, sentence
        As in :class:`rtask.asking.questions.Answer`.
    """

    key: str
    understood: str
    filled: Mapping[str, tuple[str, tuple[str, ...]]]
    sparql: str
    rows: Solutions
    names: Mapping[Term, str]
    sentence: str


def asks_about(text: str) -> str | None:
    """Return what a question asks to be told about; empty for the graph itself, None for others.

    >>> asks_about("What is the red mug?"), asks_about("what does rt:graspWidth mean?")
    ('red mug', 'rt:graspWidth')
    >>> asks_about("what can I ask?"), asks_about("Where is the mug?") is None
    ('', True)
    """
    text = " ".join(text.split())
    if _GRAPH.match(text):
        return ""
    match = _MEANS.match(text) or _WHAT.match(text)
    if match is None:
        return None
    noun = _ARTICLE.sub("", match["noun"]).strip().removesuffix(" like")
    return noun or None


def about(
    select: Select, noun: str, tokens: Sequence[str], mentions: Sequence[Mention], base: str = ""
) -> About | None:
    """Return what the graph states of the one thing or term that words name; None if of none.

    Parameters
    ----------
    noun
        As of :func:`asks_about`.
    tokens, mentions
        Words of the question, and what they name.
    base
        What ``kb:`` stands for.
    """
    if not noun:
        return _overview(select)
    spoken_of = noun.strip('"<>').lower()
    whole = [item for item in mentions if item.text.lower() == spoken_of]
    if _asks_for_kind(tokens, spoken_of) and (card := _card(select, noun, whole, base)):
        return card  # what a mug is, not which one is called so
    things = [item for item in whole if item.role in _INDIVIDUAL and not item.is_plural]
    terms = dict.fromkeys(term for item in things for term in item.terms)
    named = [term for term in terms if isinstance(term, NamedNode)]
    if len(named) == 1:
        return _individual(select, noun, named[0])
    if len(named) > 1:
        return _several(select, noun, named)
    return _card(select, noun, whole, base) or _labelled(select, noun)


def _labelled(select: Select, noun: str) -> About | None:
    """Return what is stated of the one thing of whatever class that has words for its label."""
    spoken_of = noun.strip('"<>')
    texts = {spoken_of, spoken_of.lower(), spoken_of.capitalize()}
    written = " ".join(f"{Literal(text)} {Literal(text, language='en')}" for text in sorted(texts))
    rows = select(
        with_prefixes(f"""SELECT DISTINCT ?s WHERE {{
  VALUES ?n {{ {written} }} ?s rdfs:label ?n FILTER(isIRI(?s))
}} LIMIT 2""")
    )
    terms = [row["s"] for row in rows]
    only = terms[0] if len(terms) == 1 else None
    return _individual(select, noun, only) if isinstance(only, NamedNode) else None


def _asks_for_kind(tokens: Sequence[str], noun: str) -> bool:
    words = [token.lower() for token in tokens]
    first = noun.split()[0]
    at = words.index(first) if first in words else 0
    return at > 0 and words[at - 1] in ("a", "an")


def _card(select: Select, noun: str, whole: Sequence[Mention], base: str) -> About | None:
    """Return the card of the class or property that words name; None if they name none."""
    try:
        return _term(select, noun, find_term(select, noun, base))
    except RtaskError:
        kinds = {term for item in whole if item.role.endswith("kind") for term in item.terms}
        only = next(iter(kinds), None)
        is_single = len(kinds) == 1 and isinstance(only, NamedNode) and not _is_plural(whole)
        return _term(select, noun, only) if is_single and isinstance(only, NamedNode) else None


def _is_plural(mentions: Sequence[Mention]) -> bool:
    return all(item.is_plural for item in mentions)


def _overview(select: Select) -> About:
    rows = select(_OVERVIEW)
    counts = {str(row.value("what")): int(str(row.value("count"))) for row in rows}
    order = ("robots", "objects", "places", "tasks", "grasps", "attempts to grasp", "refusals",
             "hidden causes")  # fmt: skip
    phrases = [f"{counts[what]} {what}" for what in order if counts.get(what)]
    if tried := counts.get("attempts to grasp"):
        held, failed = counts.get("that held", 0), counts.get("that failed", 0)
        phrases[phrases.index(f"{tried} attempts to grasp")] += f" ({held} held, {failed} failed)"
    words = ", ".join(phrases) or "nothing yet"
    sentence = (
        f"Shared by robots: {words}. Ask, for instance: {' '.join(_FIRST)} "
        "Or what something is, by its name."
    )
    return About(OVERVIEW, "What is in this graph, and what can be asked?", {}, _OVERVIEW, rows, {},
                 sentence)  # fmt: skip


def _term(select: Select, noun: str, term: NamedNode) -> About:
    """Return the card of a class or property as an answer."""
    card = card_of(select, term)
    sparql = with_prefixes(f"""SELECT ?property ?value WHERE {{
  {term} ?property ?value
  FILTER(isIRI(?value) || LANG(?value) IN ("", "en"))
}} LIMIT {MAX_FACTS}""")
    rows = select(sparql)
    means = card.comment.rstrip(".") or "nothing is said of what it means"
    noun_of = ("instance" if card.kind == "class" else "statement") + "s" * (card.count != 1)
    parts = [
        f"{card.label or noun} ({card.term}, a {card.kind}): {means}",
        f"{card.count} {noun_of}",
    ]
    if card.on_statements:
        properties = ", ".join(use.term for use in card.annotates)
        parts[-1] += f", {card.on_statements} of them about statements with {properties}"
    if card.kind == "class" and 0 < card.count <= MAX_LISTED:
        listed = f"SELECT DISTINCT ?s WHERE {{ ?s a {term} }} LIMIT {MAX_LISTED}"
        members = select(with_prefixes(listed))
        names = names_of(select, [row["s"] for row in members]).values()
        if called := [name for name in dict.fromkeys(names) if not _NUMBERED.fullmatch(name)]:
            parts[-1] += f", {', '.join(called)}"
    words = ". ".join(f"{part[:1].upper()}{part[1:]}" for part in parts)
    return About(
        ABOUT, f"What is {noun}?", {"term": (noun, (str(term),))}, sparql, rows,
        names_of(select, [value for row in rows for value in row]), f"{words}.",
    )  # fmt: skip


def _individual(select: Select, noun: str, term: NamedNode) -> About:
    """Return what is stated of one thing, its kinds first, as an answer."""
    sparql = with_prefixes(f"""SELECT ?property ?value ?unit WHERE {{
  {term} ?property ?value
  OPTIONAL {{ ?property rt:unit ?unit }}
  FILTER(?property != owl:sameAs && !STRSTARTS(STR(?property), "{ontology.PREFIXES["prov"]}"))
}} LIMIT {MAX_FACTS}""")
    rows = select(sparql)
    kinds = select(
        with_prefixes(f"""SELECT DISTINCT ?kind WHERE {{
  {term} a ?kind FILTER(isIRI(?kind))
  FILTER NOT EXISTS {{ {term} a ?lower . ?lower rdfs:subClassOf ?kind FILTER(?lower != ?kind) }}
}} LIMIT {_SHOWN}""")
    )
    names = names_of(select, [value for row in rows for value in row] + [term]
                     + [row["kind"] for row in kinds])  # fmt: skip
    called = names.get(term, noun)
    kind = " and ".join(sorted({names[row["kind"]] for row in kinds if row["kind"] in names})[:2])
    facts = _facts(rows, names)
    shown, left = facts[:_SHOWN], len(facts) - _SHOWN
    what = f"{called} is {'an' if kind[:1] in tuple('aeio') else 'a'} {kind}" if kind else called
    words = f"{what}: {'; '.join(shown)}" if shown else f"{what}; the graph states nothing else"
    words += f"; and {left} more properties" if left > 0 else ""
    return About(
        ABOUT, f"What is {called}?", {"object": (noun, (str(term),))}, sparql, rows, names,
        f"{words[:1].upper()}{words[1:]}.",
    )  # fmt: skip


def _facts(rows: Solutions, names: Mapping[Term, str]) -> list[str]:
    """Return the facts of a thing in words: literals first; of many values their number."""
    grouped: dict[Term, tuple[list[Term], str]] = {}
    for row in rows:
        named, value = row["property"], row["value"]
        if not isinstance(named, NamedNode) or value is None or not _is_shown(named):
            continue
        values, _ = grouped.setdefault(named, ([], _unit(row["unit"])))
        if value not in values:
            values.append(value)
    facts = []
    for named, (values, unit) in grouped.items():
        literal = isinstance(values[0], Literal)
        values = sorted(values, key=str)
        label = names.get(named, named.value) if isinstance(named, NamedNode) else ""
        if len(values) > _IN_FULL:
            least = "at least " if len(rows) == MAX_FACTS else ""
            facts.append((2, f"{label}: {least}{len(values)}"))
            continue
        shown = ", ".join(f"{spoken(value, names)} {unit}".strip() for value in values)
        facts.append((0 if literal else 1, f"{label} {shown}"))
    return [words for _, words in sorted(facts)]


def _is_shown(named: NamedNode) -> bool:
    name = named.value.removeprefix(ontology.NS)
    return named.value.startswith(ontology.NS) and name not in _OF_BOOKS


def _unit(term: Term | None) -> str:
    name = term.value.rpartition("/")[2] if isinstance(term, NamedNode) else ""
    return _UNITS.get(name, "" if name in ("UNITLESS", "NUM") else name)


def _several(select: Select, noun: str, terms: Sequence[NamedNode]) -> About:
    """Return the things of one name, with their kinds, as an answer."""
    values = " ".join(map(str, terms[:MAX_FACTS]))
    sparql = with_prefixes(f"""SELECT ?thing ?kind WHERE {{
  VALUES ?thing {{ {values} }} ?thing a ?kind FILTER(isIRI(?kind))
  FILTER NOT EXISTS {{ ?thing a ?lower . ?lower rdfs:subClassOf ?kind FILTER(?lower != ?kind) }}
}} LIMIT {MAX_FACTS}""")
    rows = select(sparql)
    names = names_of(select, [value for row in rows for value in row])
    lines = list(
        dict.fromkeys(
            f"{row['thing']} is {names.get(row['kind'], '?')}" for row in rows if row["kind"]
        )
    )
    more = len(lines) - MAX_LISTED
    listed = "; ".join(lines[:MAX_LISTED]) + (f"; and {more} more" if more > 0 else "")
    words = f"{len(terms)} things are called {noun!r}: {listed}. Ask by IRI for one of them."
    return About(
        ABOUT, f"What is {noun}?", {"object": (noun, tuple(map(str, terms)))}, sparql, rows, names,
        words,
    )  # fmt: skip
