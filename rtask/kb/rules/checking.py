"""Check of a rule's text before it is stored: syntax, names of terms, what a rule may say."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from itertools import pairwise

from pyoxigraph import NamedNode

import ontology
from rtask.errors import DataError, ParseError, QuerySyntaxError, RtaskError, nearest
from rtask.kb.rules.rule import Rule
from rtask.sparql.lexer import tokenise
from rtask.sparql.syntax import check_query
from rtask.sparql.tokens import Token, line_and_column

__all__ = ["check_rule", "rule_error", "tidy"]

MAX_TEXT = 64_000
_WORDS = frozenset(
    """
    A AS ASK ABS BASE BIND BY CONSTRUCT DATATYPE DESCRIBE DISTINCT EXISTS FALSE FILTER FROM GRAPH
    GROUP HAVING IF IN LIMIT MINUS NAMED NOT OFFSET OPTIONAL ORDER PREFIX SELECT SERVICE STR TRUE
    UNION VALUES VERSION WHERE
    """.split()  # noqa: SIM905 - a list of words reads best as words
)
_POSITION = re.compile(r"^query (?:\d+:\d+: )?")


def tidy(rule: Rule) -> Rule:
    """Return a rule without heading, blank edges and gaps, as it is stored."""
    lines = [line.rstrip() for line in rule.text.splitlines()]
    remaining = [line for line in lines if not re.match(r"#\s*rule:", line)]
    text = re.sub(r"\n{3,}", "\n\n", "\n".join(remaining)).strip()
    return replace(rule, label=rule.label.strip(), text=text)


def check_rule(rule: Rule, knows: Callable[[NamedNode], bool], terms: Iterable[str]) -> None:
    """Raise unless a text is a rule that the reasoner can use and whose names make sense.

    Parameters
    ----------
    knows
        Whether the knowledge base says anything about a term.
    terms
        Local names of RTASK's own terms; read only to suggest one of them.

    Raises
    ------
    ParseError
        With line, column and, where a name is near, what may have been meant.
    """
    if not rule.label.strip():
        raise ParseError("a rule has no label; give it a short name")
    if len(rule.text) > MAX_TEXT:
        raise ParseError(f"rule {rule.label!r} has more than {MAX_TEXT} characters")
    try:
        tokens = tokenise(rule.text)
    except RtaskError as error:
        raise _error(rule, str(error).partition(": ")[2], error.details) from error
    _check_words(rule, tokens)
    prefixes = _prefixes(tokens)
    _check_prefixes(rule, tokens, prefixes)
    _check_terms(rule, tokens, prefixes, knows, terms)
    _check_form(rule, tokens)
    _compile(rule)
    try:
        check_query(rule.text)
    except QuerySyntaxError as error:
        raise _error(rule, _POSITION.sub("", str(error)), error.details) from error


def _check_words(rule: Rule, tokens: list[Token]) -> None:
    for token in tokens:
        if token.kind != "word" or token.text.upper() in _WORDS:
            continue
        # Without a near word the parser's own message is the better one.
        hint = nearest(token.text.upper(), sorted(_WORDS))
        if hint:
            raise _at(rule, token, f"unknown word {token.text!r}{hint}")


def _prefixes(tokens: list[Token]) -> dict[str, str]:
    return {
        name.text: iri.text[1:-1]
        for word, name, iri in zip(tokens, tokens[1:], tokens[2:], strict=False)
        if word.is_word("PREFIX") and iri.kind == "iri"
    }


def _check_prefixes(rule: Rule, tokens: list[Token], declared: dict[str, str]) -> None:
    for before, token in pairwise(tokens):
        prefix = token.text.partition(":")[0] + ":"
        if token.kind != "name" or prefix in declared or before.is_word("PREFIX"):
            continue
        namespace = ontology.PREFIXES.get(prefix[:-1])
        hint = (
            f"; add PREFIX {prefix} <{namespace}>" if namespace else nearest(prefix, list(declared))
        )
        raise _at(rule, token, f"undeclared prefix {prefix!r}{hint}")


def _check_terms(
    rule: Rule,
    tokens: list[Token],
    prefixes: dict[str, str],
    knows: Callable[[NamedNode], bool],
    terms: Iterable[str],
) -> None:
    """Refuse names in RTASK's own namespace that no ontology declares: they match nothing."""
    for token, iri in _iris(tokens, prefixes):
        name = iri.removeprefix(ontology.NS)
        # Names of other vocabularies may come later; ours are all declared, so that one that is not
        # is a slip.
        if name in (iri, "") or knows(NamedNode(iri)):
            continue
        hint = nearest(name, list(terms))
        raise _at(rule, token, f"unknown term {token.text}{hint}")


def _iris(tokens: list[Token], prefixes: dict[str, str]) -> Iterator[tuple[Token, str]]:
    for before, token in pairwise(tokens):
        if token.kind == "name" and not before.is_word("PREFIX"):
            prefix, _, local = token.text.partition(":")
            yield token, prefixes.get(prefix + ":", "") + local
        elif token.kind == "iri" and before.kind != "name":
            yield token, token.text[1:-1]


def _check_form(rule: Rule, tokens: list[Token]) -> None:
    """Refuse SERVICE before anything is parsed, and texts that are no CONSTRUCT."""
    for token in tokens:
        if token.is_word("SERVICE"):
            raise _at(rule, token, "SERVICE cannot be used in a rule; load the data first")
    for token in tokens:
        if token.is_word("SELECT", "ASK", "DESCRIBE"):
            raise _at(rule, token, "a rule is a CONSTRUCT query")
        if token.is_word("CONSTRUCT"):
            return


def _compile(rule: Rule) -> None:
    """Compile the rule for nothing but its errors; the reasoner places those of syntax badly."""
    from reasoner import LabelledRule, RuleError
    from reasoner.rules.user_rules import compile_rule
    from reasoner.terms.dictionary import Dictionary

    try:
        compile_rule(LabelledRule(rule.text, rule.label), Dictionary().encode)
    except RuleError as error:
        # Of syntax the store's parser knows line and column.
        if not error.reason.startswith("not a SPARQL query"):
            raise rule_error(rule, error) from error
        check = None
        try:
            check_query(rule.text)
        except QuerySyntaxError as better:
            check = better
        if check is not None:
            raise _error(rule, _POSITION.sub("", str(check)), check.details) from error
        raise rule_error(rule, error) from error


def rule_error(rule: Rule, error: Exception) -> DataError:
    """Return the reasoner's refusal of a rule as an error of the knowledge base."""
    line, column = getattr(error, "line", None), getattr(error, "column", None)
    reason = str(getattr(error, "reason", error))
    return _error(rule, reason, {"line": line, "column": column})


def _at(rule: Rule, token: Token, reason: str) -> ParseError:
    line, column = line_and_column(rule.text, token.start)
    return _error(rule, reason, {"line": line, "column": column})


def _error(rule: Rule, reason: str, details: dict[str, object]) -> ParseError:
    line, column = details.get("line"), details.get("column")
    place = f" {line}:{column}" if line and column else f" {line}" if line else ""
    first = reason.splitlines()[0] if reason else "cannot be read"
    suggestion = re.search(r"did you mean '([^']+)'", reason)
    extra = {"did_you_mean": suggestion[1]} if suggestion else {}
    return ParseError(
        f"rule {rule.label!r}{place}: {first}; nothing was stored",
        line=line,
        column=column,
        rule=rule.label,
        **extra,
    )
