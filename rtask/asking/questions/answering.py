"""Answers to questions in words: the nearest of the ontology's questions, with its slots filled.

No model takes part. The words, corrected for spelling, are compared with several phrasings of each
question; what they name fills its slots; its query is shown beside the answer.
"""

from __future__ import annotations

import datetime as dt
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, Protocol
from urllib.parse import urlencode

from rtask.asking.questions.about import MAX_FACTS, MAX_NOUN, About, about, asks_about
from rtask.asking.questions.beliefs import (
    BELIEFS,
    ChangedBeliefs,
    asks_for_changes,
    changed_beliefs,
    past_states,
)
from rtask.asking.questions.catalogue import Question
from rtask.asking.questions.counting import Noun, count_of, counting_of, noun_counted
from rtask.asking.questions.filling import (
    Filled,
    by_role,
    fill,
    filled_query,
    individual,
    single_things,
    unused_mentions,
)
from rtask.asking.questions.matching import APART, ASKED, NEAR, Match, matcher
from rtask.asking.questions.mentions import (
    MAX_MENTIONS,
    Select,
)
from rtask.asking.questions.missing import missing_name, missing_number, not_named
from rtask.asking.questions.periods import find_period
from rtask.asking.questions.reading import Reading, read
from rtask.asking.questions.scope import command, superlatives, unanswerable
from rtask.asking.questions.sentences import MAX_CLAUSES, called_only, names_of, sentence
from rtask.asking.questions.totals import (
    BY_KIND,
    TOTAL,
    Part,
    counted_in,
    counts_attempts,
    total,
)
from rtask.asking.questions.why import why_of, why_of_attempts, why_of_facts
from rtask.asking.questions.words import split_name
from rtask.errors import UsageError
from rtask.rdf.terms import Term, python_value
from rtask.sparql.results import Solutions

__all__ = ["MAX_ROWS", "Answer", "Near", "Selectable", "answer"]

MAX_ROWS = 200
MAX_TEXT = 1000
TIMEOUT_S = 10.0
_LISTED = 3
MIN_WORDED = 0.25
"""Likeness below which words say too little for :data:`CLEARLY`: "wich boxes are there"."""
CLEARLY = 0.03
"""By how much the nearest question must be nearer than the next; less is a guess.

Of what is nearer than this to two questions, about half would be answered with the wrong one.
"""


class Selectable(Protocol):
    """A graph, embedded or on a server."""

    def select(self, text: str, **options: Any) -> Solutions:
        """Evaluate a SELECT."""


@dataclass(frozen=True)
class Near:
    """A question that is near to the words.

    Parameters
    ----------
    key
        Name of its file in ``ontology/queries``.
    question
        Its words.
    likeness
        About 0 to 1.
    """

    key: str
    question: str
    likeness: float


@dataclass(frozen=True)
class Answer:
    """What a question in words was understood as, and its answer.

    Parameters
    ----------
    text
        The question as it was asked.
    key
        Name of the question that was answered, ``about`` for what something is; empty if none is
        near.
    understood
        That question with what fills its slots, in words; empty if none is near.
    filled
        Words and terms of each slot that is filled, by role; a second one is ``robot 2``.
    ignored
        Words that mean nothing here, and names for which the question has no place.
    sparql
        The query that was evaluated.
    rows
        Its solutions, at most :data:`MAX_ROWS`; none if none is near.
    names
        Words for the IRIs in the rows.
    sentence
        The answer in words. Without rows it says that nothing is known, which is not "no".
    nearest
        The three questions that are nearest, the best first.
    is_cut
        Whether there are more rows.
    why
        Addresses, on a server, of what the numbers of each row rest on; empty for a row without.
    count
        How many things there are in the answer, if the question counts them.
    """

    text: str
    key: str
    understood: str
    filled: Mapping[str, tuple[str, tuple[str, ...]]]
    ignored: tuple[str, ...]
    sparql: str
    rows: Solutions
    names: Mapping[str, str]
    sentence: str
    nearest: tuple[Near, ...]
    is_cut: bool = False
    why: tuple[str, ...] = ()
    count: int | None = None

    @property
    def is_understood(self) -> bool:
        """Whether a question is near, and all that it names is there."""
        return bool(self.sparql)

    def to_dict(self) -> dict[str, Any]:
        """Return the answer as JSON-able values."""
        return {
            "text": self.text,
            "question": self.key or None,
            "understood": self.understood,
            "filled": {role: {"words": words, "terms": list(terms)}
                       for role, (words, terms) in self.filled.items()},
            "ignored": list(self.ignored),
            "sparql": self.sparql,
            "sentence": self.sentence,
            "count": self.count,
            "variables": list(self.rows.variables),
            "rows": self.rows.to_dicts(),
            "names": dict(self.names),
            "why": list(self.why),
            "more": self.is_cut,
            "nearest": [
                {"question": item.key, "text": item.question, "likeness": round(item.likeness, 3)}
                for item in self.nearest
            ],
        }  # fmt: skip


def answer(
    kb: Selectable,
    text: str,
    *,
    select: Select | None = None,
    now: dt.datetime | None = None,
) -> Answer:
    """Answer a question in words.

    Parameters
    ----------
    kb
        The graph, embedded or on a server.
    text
        The question, such as ``which robot fails at cartons, and why?``.
    select
        Evaluates the queries, with the rights and within the bounds of whoever asks; by default
        the graph itself, for at most :data:`TIMEOUT_S` each.
    now
        What "today" refers to; by default the present.

    Raises
    ------
    UsageError
        The text is empty, longer than :data:`MAX_TEXT`, or of too many words.
    QueryTimeout
        A query took too long.
    UnsupportedError, GoneError, TooLargeError, BusyError
        It asks what has changed, and the graph keeps no earlier states here, or none so old.

    Examples
    --------
    >>> import ontology, rtask
    >>> from rtask.rdf.terms import prologue
    >>> with rtask.open(":memory:") as kb:
    ...     text = "INSERT DATA { <urn:cup> a rt:Cup ; rt:name 'red cup' }"
    ...     _ = kb.update(prologue(ontology.PREFIXES) + text)
    ...     result = answer(kb, "which cups are there?")
    >>> result.sentence
    'Cups: red cup.'
    """
    if not text.strip() or len(text) > MAX_TEXT:
        raise UsageError(f"a question has 1 to {MAX_TEXT} characters, not {len(text)}")
    run = select or _within_bounds(kb)
    now = now or dt.datetime.now(dt.UTC)
    # Before all else: what changed is asked of two states, and no stored question does that.
    if asks_for_changes(text, find_period(text, now)):
        changed = changed_beliefs(
            run, past_states(kb, TIMEOUT_S), text, find_period(text, now), now
        )
        return _changes(text, changed)
    reading = read(run, text, str(getattr(kb, "base", "")), now)
    if (counted := counted_in(text)) is not None:
        return _total(run, text, counted, reading)
    if counts_attempts(text) and (part := _part_named(reading)) is not None:
        return _total_of(run, text, part, reading)
    return _answer(run, text, reading, str(getattr(kb, "base", "")))


def _total(run: Select, text: str, noun: str, reading: Reading) -> Answer:
    """Return the answer to how many things of a sort there are, with their kinds if any counts."""
    whole = total(run, noun)
    matches = matcher().matches(reading.asked)
    if matches[0].question.key == BY_KIND:
        by_kind = _answered(run, text, reading, matches[0].question, _nearest(matches))
        if by_kind.is_understood:
            words = f"{whole.sentence} {by_kind.sentence}"
            return replace(by_kind, sentence=words, count=whole.count)
    return Answer(
        text, TOTAL, whole.understood, {}, (), whole.sparql, whole.rows, {}, whole.sentence,
        _nearest(matches), why=why_of(run, whole.rows, whole.sparql), count=whole.count,
    )  # fmt: skip


def _part_named(reading: Reading) -> Part | None:
    """Return the things and robots whose attempts are counted; None if none or others are named."""
    if reading.ignored or reading.period is not None:
        return None
    if missing_number(reading.tokens, reading.mentions):
        return None
    named = {role: [item for item in reading.mentions if item.role == role]
             for role in ("object", "robot", "kind")}  # fmt: skip
    if named["object"]:
        named["kind"] = []  # "the box" is any box only where no single one is meant
    if not any(named.values()):
        return None
    places = {(item.start, item.end) for items in named.values() for item in items}
    if {(item.start, item.end) for item in reading.mentions} - places:
        return None
    words = [f"{'by' if role == 'robot' else 'at'} {item.text}"
             for role, items in named.items() for item in items]  # fmt: skip
    terms = {role: tuple(dict.fromkeys(str(term) for item in items for term in item.terms))
             for role, items in named.items()}  # fmt: skip
    return Part(terms["object"], terms["robot"], terms["kind"], " ".join(words))


def _total_of(run: Select, text: str, part: Part, reading: Reading) -> Answer:
    """Return the answer to how many attempts there were at a thing or by a robot."""
    whole = total(run, "attempts", part)
    filled = {
        item.role: (item.text, tuple(map(str, item.terms)))
        for item in reading.mentions
        if set(map(str, item.terms)) & {*part.objects, *part.robots, *part.kinds}
    }
    return Answer(
        text, TOTAL, whole.understood, filled, (), whole.sparql, whole.rows, {}, whole.sentence,
        _nearest(matcher().matches(reading.asked)),
        why=(why_of_attempts(part.objects, part.robots) or why_of(run, whole.rows, whole.sparql)),
        count=whole.count,
    )  # fmt: skip


def _answer(run: Select, text: str, reading: Reading, base: str) -> Answer:
    """Return the answer to any other question."""
    # "What is X?" is answered by what X is, and would be near to every question about X.
    noun = asks_about(text)
    if noun is not None:
        match = about(run, noun, reading.tokens, reading.mentions, base)
        if match is not None:
            return _answer_about(run, text, match)
        if reading.ignored and len(noun.split()) <= MAX_NOUN and "there" not in noun:
            return _unanswered(text, reading, not_named(noun, reading.mentions), ())
    matches = matcher().matches(reading.asked)
    nearest = _nearest(matches)
    best = matches[0]
    # Said in words: whoever gives an order must not believe that it was carried out.
    if command(text):
        words = "That tells a robot to do something, and nothing was done: here are only answers."
        return _unanswered(text, reading, _with_nearest(words, nearest), nearest)
    # A number that names nothing would be dropped, and the answer be about everything.
    if missing := missing_number(reading.tokens, reading.mentions):
        return _unanswered(text, reading, not_named(missing, reading.mentions), nearest)
    if best.score < NEAR:
        return _unanswered(text, reading, _with_nearest(_FAR, nearest), nearest)
    return _answered(run, text, reading, best.question, nearest)


def _answered(
    run: Select, text: str, reading: Reading, question: Question, nearest: tuple[Near, ...]
) -> Answer:
    """Return the answer to one of the questions, or why its slots cannot be filled."""
    filled = fill(question, reading.mentions, reading.period)
    if missing := missing_name(question, filled, reading.tokens, reading.ignored):
        return _unanswered(text, reading, not_named(missing, reading.mentions), nearest)
    if why := _out_of_scope(text, reading, question, nearest):
        return _unanswered(text, reading, _with_nearest(why, nearest), nearest)
    # A guess between two would be wrong half of the time; the person can say which.
    if nearest[0].likeness > MIN_WORDED and nearest[0].likeness - nearest[1].likeness < CLEARLY:
        listed = " Or: ".join(item.question for item in nearest[:2])
        return _unanswered(text, reading, f"That can mean: {listed} Ask one of them.", nearest)
    sparql = filled_query(question, filled)
    noun, counts = noun_counted(reading.tokens), None
    if noun is not None:
        counted = Noun(noun, reading.tokens, reading.mentions)
        counts, is_answered = counting_of(question, filled, sparql, counted)
        if not is_answered:
            words = f"What is called {reading.tokens[noun]!r} cannot be counted here."
            return _unanswered(text, reading, words, nearest)
    sparql = counts.listed if counts is not None else sparql
    unused = unused_mentions(question, filled, reading.mentions)
    # An answer about others would look like one about the thing that was named.
    if out_of_place := individual(unused, reading.mentions):
        words = (
            f"The nearest question, {question.text!r}, is not about {out_of_place!r}: an answer "
            "would be about others. Ask without it, or ask another question."
        )
        return _unanswered(text, reading, words, nearest)
    if reading.period is not None and all(item.period is None for item in filled):
        unused.append(reading.period.text)
    unused += superlatives(text, question.text)
    reading = replace(reading, ignored=tuple(dict.fromkeys([*reading.ignored, *unused])))
    # One row more than is shown tells that there are more.
    rows = run(_limited(sparql))
    is_cut = len(rows) > MAX_ROWS
    count = None if counts is None else count_of(run, counts, rows, is_cut)
    rows = rows[:MAX_ROWS]
    names = names_of(run, [term for row in rows for term in row])
    return Answer(
        text,
        question.key,
        _understood(question, filled),
        by_role(filled),
        reading.ignored,
        sparql,
        rows,
        {str(python_value(term)): name for term, name in names.items()},
        _counted_words(count)
        + _answer_words(question, filled, reading, rows, names, is_cut)
        + called_only(run, filled, rows),
        nearest,
        is_cut,
        why_of(run, rows, sparql, single_things(filled)),
        count,
    )


_FAR = "None of the questions is near to that."


def _out_of_scope(
    text: str, reading: Reading, question: Question, nearest: tuple[Near, ...]
) -> str:
    """Return why the nearest question is not the one that is asked, or nothing."""
    asked, phrases = reading.asked, matcher().phrases(question)
    roles = {role for item in asked.roles for role in item}
    first, second = nearest[0].likeness, nearest[1].likeness
    why = unanswerable(text, asked.words, asked.names, reading.ignored, phrases, first, roles)
    return why or (_FAR if first < ASKED and first - second < APART else "")


def _with_nearest(words: str, nearest: tuple[Near, ...]) -> str:
    listed = "; ".join(item.question for item in nearest)
    return f"{words} The nearest are: {listed}"


def _counted_words(count: int | None) -> str:
    return f"{count} known. " if count else ""


def _changes(text: str, changed: ChangedBeliefs) -> Answer:
    """Return the answer to what has changed."""
    rows = changed.rows[:MAX_ROWS]
    shown = list(changed.clauses[:MAX_CLAUSES])
    left = len(changed.clauses) - len(shown)
    words = "; ".join([*shown, f"and {left} more"] if left else shown)
    if not shown:
        words = f"no belief changed {changed.period}; `rtask history` lists the commits"
    return Answer(
        text, "beliefs", f"Which beliefs changed {changed.period}?", {}, (), BELIEFS, rows, {},
        f"{words[:1].upper()}{words[1:]}.", (), len(changed.rows) > MAX_ROWS,
        tuple(f"/resource?{urlencode({'iri': str(row.value('about'))})}" for row in rows),
    )  # fmt: skip


def _answer_about(run: Select, text: str, answer: About) -> Answer:
    """Return the answer to what something is."""
    rows = answer.rows[:MAX_ROWS]
    named = {term.strip("<>") for _, terms in answer.filled.values() for term in terms}
    thing = named.pop() if len(named) == 1 else ""
    return Answer(
        text, answer.key, answer.understood, answer.filled, (), answer.sparql, rows,
        {str(python_value(term)): name for term, name in answer.names.items()}, answer.sentence,
        (), len(answer.rows) > MAX_ROWS or len(answer.rows) == MAX_FACTS,
        why_of_facts(rows, thing) if thing else why_of(run, rows, answer.sparql),
    )  # fmt: skip


def _within_bounds(kb: Selectable) -> Select:
    def run(query: str) -> Solutions:
        return kb.select(query, timeout_s=TIMEOUT_S)

    return run


def _nearest(matches: list[Match]) -> tuple[Near, ...]:
    """Return the nearest questions, of several that ask the same the best."""
    groups: dict[str, Near] = {}
    for item in matches:
        near = Near(item.question.key, item.question.text, item.score)
        groups.setdefault(item.question.group, near)
    return tuple(groups.values())[:_LISTED]


def _limited(sparql: str) -> str:
    has_limit = "LIMIT" in sparql[sparql.rindex("}") :]
    return sparql if has_limit else f"{sparql.rstrip()}\nLIMIT {MAX_ROWS + 1}\n"


def _understood(question: Question, filled: list[Filled]) -> str:
    """Return the question with what fills its slots."""
    wording = question.phrases[0]
    text, by_role = wording.text, {item.slot.role: item for item in filled if item.slot.is_constant}
    for role, words, _ in wording.filled:
        item = by_role.get(role)
        if item is not None:
            text = text.replace(words, item.text, 1)
        elif not role.endswith("kind"):
            text = text.replace(f"the {words}", words, 1).replace(words, f"any {role}", 1)
    only = [
        f"{item.slot.role.replace('_', ' ')}: {item.text}"
        for item in filled
        if not item.slot.is_constant
        or item.slot.role not in {role for role, _, _ in wording.filled}
    ]
    return text + (f" ({'; '.join(only)})" if only else "")


def _answer_words(
    question: Question,
    filled: list[Filled],
    reading: Reading,
    rows: Solutions,
    names: Mapping[Term, str],
    is_cut: bool,
) -> str:
    doubt = ""
    if reading.ignored:
        doubt = f" Not considered: {', '.join(reading.ignored)}."
    if any(item.is_cut for item in reading.mentions):
        doubt += (
            f" The words name more than {MAX_MENTIONS} things, of which {MAX_MENTIONS} were looked"
            " at: more may answer this. A full name in quotes, or an IRI, names fewer."
        )
    if not len(rows):
        return "The graph states nothing that answers this; that does not mean no." + doubt
    given = {item.slot.role: item.text for item in filled}
    for role, words, _ in question.phrases[0].filled:
        given.setdefault(role, words)
    for slot in question.slots:
        if slot.is_constant:
            given.setdefault(slot.role, " ".join(split_name(slot.term.partition(":")[2])))
    more = f" There are more than {MAX_ROWS} rows." if is_cut else ""
    return sentence(question.answer, rows, names, given) + more + doubt


def _unanswered(text: str, reading: Reading, words: str, nearest: tuple[Near, ...]) -> Answer:
    return Answer(text, "", "", {}, reading.ignored, "", Solutions((), ()), {}, words, nearest)
