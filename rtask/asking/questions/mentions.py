"""What a question names: objects, kinds, robots, tasks and more, found by their names and labels.

All names are looked up in one query; each occurrence of a term is read in the forms in which
commands print it.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import ontology
from rtask.asking.questions.words import STOP, forms, stem
from rtask.asking.terms import Reader
from rtask.errors import RtaskError, UsageError
from rtask.kb.search.text import single_words
from rtask.rdf.terms import Literal, NamedNode, Term
from rtask.sparql.results import Solutions

__all__ = [
    "MAX_MENTIONS", "Mention", "Select", "find_by_part", "find_mentions", "is_numbered",
    "tokens_of", "with_called",
]  # fmt: skip

Select = Callable[[str], Solutions]
"""Evaluates a SELECT with the rights and within the bounds of whoever asks."""

_ROLES = {
    "object": "rt:ManipulableObject", "robot": "cora:Robot", "task": "rt:Task",
    "grasp": "rt:GraspConfiguration", "frame": "rt:Frame", "recognition": "rt:RecognitionResult",
    "cloud": "rt:PointCloud", "use": "rt:ObjectFunction",
    "colour": "rt:Colour", "trait": "rt:ObjectTrait", "place": "rt:SupportSurface",
}  # fmt: skip
_KINDS = {"kind": "rt:ManipulableObject", "robot_kind": "cora:Robot"}
_TOKEN = re.compile(
    r"<[^\s<>]+>|[A-Za-z][\w.\-]*:[^\s?,;!]*[\w/]|\"[^\"\n]{1,200}\"|[\w]+(?:[-'’./]\w+)*"
)
_DETERMINERS = frozenset(re.findall(r"\w+", "a the any some this that my your each every no"))
MAX_WORDS = 60
MAX_NAME_WORDS = 4
MAX_MENTIONS = 1000
MIN_PART = 3
"""Letters of the shortest word that is looked for in names."""


@dataclass(frozen=True)
class Mention:
    """A stretch of a question that names something.

    Parameters
    ----------
    start, end
        Tokens of the question; the end is not included.
    text
        The words.
    role
        What it can stand for.
    terms
        All that have this name.
    is_plural
        The words are a plural, and the name is their singular.
    is_cut
        The question names more than :data:`MAX_MENTIONS` things, of which only so many were read:
        more may have this name.
    called
        Of a kind: objects whose names end in its word, of whatever class they are.
    """

    start: int
    end: int
    text: str
    role: str
    terms: tuple[Term, ...]
    is_plural: bool = False
    is_cut: bool = False
    called: tuple[Term, ...] = ()


def tokens_of(text: str) -> list[str]:
    """Return the words, terms and quoted names of a question.

    Raises
    ------
    UsageError
        There are more than :data:`MAX_WORDS`; what the rest says would be missed in silence.

    Examples
    --------
    >>> tokens_of('Where is "the red mug", kb:object/7 or nao-1?')
    ['Where', 'is', '"the red mug"', 'kb:object/7', 'or', 'nao-1']
    """
    tokens = _TOKEN.findall(text)
    if len(tokens) > MAX_WORDS:
        raise UsageError(f"a question has at most {MAX_WORDS} words, not {len(tokens)}")
    return tokens


def find_mentions(
    select: Select,
    tokens: list[str],
    base: str = "",
    roles: Mapping[str, str] = _ROLES,
    kinds: Mapping[str, str] = _KINDS,
    has_modals: bool = True,
) -> list[Mention]:
    """Return what the tokens of a question name; longer names hide what lies within them.

    Parameters
    ----------
    base
        What ``kb:`` stands for; empty where that is not known.
    roles, kinds
        Roles that a mention can have: of the instances of a class, and of the classes below one.
    has_modals
        Whether "can" is a verb where no article stands before it; else it is always the object.
    """
    names, terms = _candidates(tokens, base, has_modals)
    rows = _look_up(select, names, terms, roles, kinds)
    is_cut = len(rows) > MAX_MENTIONS
    result: dict[tuple[int, int, str], list[tuple[Term, bool]]] = {}
    for row in rows[:MAX_MENTIONS]:
        name, term, role = row["n"], row["s"], str(row.value("role"))
        places = terms.get(term, []) if name is None else names.get(_text(name), [])
        for start, end in places:
            wording = " ".join(tokens[start:end]).strip('"')
            is_plural = name is not None and _is_plural(wording, _text(name))
            assert term is not None
            result.setdefault((start, end, role), []).append((term, is_plural))
    mentions = [
        Mention(start, end, " ".join(tokens[start:end]).strip('"<>'), role,
                tuple(dict.fromkeys(term for term, _ in named)),
                all(is_plural for _, is_plural in named), is_cut)
        for (start, end, role), named in result.items()
    ]  # fmt: skip
    mentions = [item for item in mentions if not _asks_how(tokens, item)]
    return sorted(_longest(mentions), key=lambda item: (item.start, item.role))


def with_called(
    select: Select, tokens: Sequence[str], mentions: Iterable[Mention]
) -> list[Mention]:
    """Return mentions, those of a kind with the objects that are called so.

    Nobody need have said that carton-7 is a carton, and a question about cartons means it, too.
    """
    mentions = list(mentions)
    kinds = [item.start for item in mentions if item.role == "kind" and item.end == item.start + 1]
    called = {item.start: item for item in find_by_part(select, tokens, kinds, at_end=True)}
    return [
        replace(item, called=called[item.start].terms,
                is_cut=item.is_cut or called[item.start].is_cut)
        if item.role == "kind" and item.start in called and item.end == item.start + 1 else item
        for item in mentions
    ]  # fmt: skip


_ON_PRINT = """
  UNION {
    VALUES ?word { %s }
    ?line rt:wordToken ?word . ?reading rt:hasWord ?line . ?view rt:viewContent ?reading .
    ?named rt:hasView ?view
    BIND("object" AS ?role)
  }"""


def find_by_part(
    select: Select, tokens: Sequence[str], places: Iterable[int], at_end: bool = False
) -> list[Mention]:
    """Return what has a word of a question in its name: "cartons" are carton-7, "a nao" is nao-1.

    So do objects on whose views the word was read: "the carton that says naturell".

    Parameters
    ----------
    tokens
        The words of the question.
    places
        Where the words stand that mean nothing else.
    at_end
        Only objects, and the word must be the name's last, as the head of an English noun: a pen
        box is no pen.
    """
    end = "[^a-z]*$" if at_end else "([^a-z]|$)"
    words = {
        form: at for at in places if not is_numbered(tokens[at])
        for form in (tokens[at].lower(), stem(tokens[at].lower()), *single_words(tokens[at]))
        if len(form) >= MIN_PART and form.isalpha()
    }  # fmt: skip
    if not words:
        return []
    prefixes = f"PREFIX rt: <{ontology.NS}>\nPREFIX cora: <{ontology.PREFIXES['cora']}>"
    whole = "" if at_end else '("robot" cora:Robot)'
    written = " ".join(str(Literal(word)) for word in words)
    rows = select(f"""{prefixes}
SELECT DISTINCT ?word ?named ?role WHERE {{
  {{
    VALUES ?word {{ {written} }}
    VALUES (?role ?top) {{ ("object" rt:ManipulableObject) {whole} }}
    ?named a ?top ; rt:name ?name
    FILTER(REGEX(?name, CONCAT("(^|[^a-z])", ?word, "{end}"), "i"))
  }}{"" if at_end else _ON_PRINT % written}
}} LIMIT {MAX_MENTIONS + 1}""")
    called: dict[tuple[int, str], list[Term]] = {}
    for row in rows[:MAX_MENTIONS]:
        word, term = row["word"], row["named"]
        assert word is not None
        assert term is not None
        called.setdefault((words[_text(word)], str(row.value("role"))), []).append(term)
    is_cut = len(rows) > MAX_MENTIONS
    return [
        Mention(at, at + 1, tokens[at], role, tuple(dict.fromkeys(terms)), is_cut=is_cut)
        for (at, role), terms in sorted(called.items())
    ]


def is_numbered(token: str) -> bool:
    """Return whether a word is the name of a single thing: carton-7 is not just any carton.

    >>> [is_numbered(token) for token in ("carton-7", "kb:object/7", "7", "2026-11-30", "nao")]
    [True, True, False, False, False]
    """
    return re.match(r"[^\W\d_].*\d", token) is not None


def _text(term: Term) -> str:
    assert isinstance(term, Literal)
    return term.value


def _is_plural(wording: str, name: str) -> bool:
    return wording.lower() != name.lower() and wording.lower().endswith("s")


_Places = dict[str, list[tuple[int, int]]]


def _candidates(
    tokens: list[str], base: str, has_modals: bool
) -> tuple[_Places, dict[Term | None, list[tuple[int, int]]]]:
    """Return the names and the terms that stretches of a question may be, with their places."""
    reader = Reader(base)
    names: _Places = {}
    terms: dict[Term | None, list[tuple[int, int]]] = {}
    for start, end in _stretches(tokens):
        words = [token.strip('"') for token in tokens[start:end]]
        if end - start == 1 and _is_term(tokens[start]):
            term = _read(reader, tokens[start])
            if term is not None:
                terms.setdefault(term, []).append((start, end))
            continue
        is_modal = _is_modal(tokens, start, end)
        if has_modals if is_modal else all(word.lower() in STOP for word in words):
            continue
        for name in forms(words):
            names.setdefault(name, []).append((start, end))
        if end - start > 1 and words[-1].isdigit():  # "carton 6" for carton-6
            for name in forms(["-".join(words)]):
                names.setdefault(name, []).append((start, end))
        if base and end - start <= 2:
            local = _read(reader, "kb:" + "/".join(words))
            if local is not None:
                terms.setdefault(local, []).append((start, end))
    return names, terms


def _stretches(tokens: list[str]) -> Iterator[tuple[int, int]]:
    for start in range(len(tokens)):
        for end in range(start + 1, min(start + MAX_NAME_WORDS, len(tokens)) + 1):
            yield start, end


def _is_modal(tokens: list[str], start: int, end: int) -> bool:
    """Return whether a stretch is the verb "can" rather than the object."""
    before = tokens[start - 1].lower() if start else ""
    return end - start == 1 and tokens[start].lower() == "can" and before not in _DETERMINERS


def _asks_how(tokens: Sequence[str], item: Mention) -> bool:
    """Return whether a trait is asked for, and does not name a thing: "how heavy", "heaviest"."""
    is_most = item.text.lower().endswith("iest")
    before = tokens[item.start - 1].lower() if item.start else ""
    return item.role == "trait" and (is_most or before == "how")


def _is_term(token: str) -> bool:
    return token.startswith("<") or (":" in token and not token.startswith('"'))


def _read(reader: Reader, token: str) -> NamedNode | None:
    try:
        term = reader.term(token)
    except RtaskError:
        return None
    return term if isinstance(term, NamedNode) else None


def _look_up(
    select: Select,
    names: Mapping[str, object],
    terms: Mapping[Term | None, object],
    roles: Mapping[str, str],
    kinds: Mapping[str, str],
) -> Solutions:
    literals = [
        str(Literal(name, language=language)) if language else str(Literal(name))
        for name in names
        for language in (None, "en")
    ]
    prefixes = "\n".join(
        f"PREFIX {name}: <{ontology.PREFIXES[name]}>" for name in ("rt", "cora", "rdfs", "skos")
    )
    individuals = " ".join(f'("{role}" {top})' for role, top in roles.items())
    classes = " ".join(f'("{role}" {top})' for role, top in kinds.items())
    written = " ".join(literals)
    return select(f"""{prefixes}
SELECT DISTINCT ?n ?s ?role WHERE {{
  {{
    {{
      VALUES ?n {{ {written} }}
      {{ ?s rt:name ?n }} UNION {{ ?s rdfs:label ?n }} UNION {{ ?s skos:altLabel ?n }}
    }}
    UNION {{ VALUES ?s {{ {" ".join(str(term) for term in terms)} }} }}
    {{ VALUES (?role ?top) {{ {individuals} }} ?s a/rdfs:subClassOf* ?top }}
    UNION {{ VALUES (?role ?top) {{ {classes} }} ?s rdfs:subClassOf+ ?top FILTER(?s != ?top) }}
  }}
  UNION {{
    VALUES ?n {{ {written} }}
    {{ ?hand rt:gripperType ?n BIND(?n AS ?s) }}
    UNION {{ ?hand rt:name ?n ; rt:gripperType ?s }}
    BIND("hand" AS ?role)
  }}
}} LIMIT {MAX_MENTIONS + 1}""")


def _longest(mentions: list[Mention]) -> list[Mention]:
    """Return mentions that no longer one contains or overlaps."""
    chosen: list[Mention] = []
    for item in sorted(mentions, key=lambda m: (m.start - m.end, m.start)):
        is_free = all(
            item.end <= other.start or other.end <= item.start
            or (item.start, item.end) == (other.start, other.end)
            for other in chosen
        )  # fmt: skip
        if is_free:
            chosen.append(item)
    return chosen
