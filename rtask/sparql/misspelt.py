"""Words of a SPARQL text that the grammar does not have, with what was probably meant.

The store's parser names the alternative that it tried last: for ``SELEC`` it expects CONSTRUCT.
"""

from __future__ import annotations

import difflib

from rtask.sparql.lexer import body_start
from rtask.sparql.tokens import Token

__all__ = ["bare_slash", "misplaced", "misspelling", "unbalanced"]

_QUERY_FORMS = ("SELECT", "CONSTRUCT", "DESCRIBE", "ASK")
_UPDATE_FORMS = (
    "INSERT", "DELETE", "WITH", "LOAD", "CLEAR", "DROP", "CREATE", "ADD", "MOVE", "COPY",
)  # fmt: skip
_OTHERS = (
    "BASE PREFIX VERSION DISTINCT REDUCED AS FROM NAMED WHERE ORDER BY ASC DESC LIMIT OFFSET "
    "VALUES GROUP HAVING SILENT INTO TO DEFAULT ALL DATA USING GRAPH OPTIONAL SERVICE BIND "
    "UNDEF MINUS UNION FILTER NOT IN EXISTS LATERAL SEPARATOR TRUE FALSE A STR LANG "
    "LANGMATCHES LANGDIR HASLANG HASLANGDIR DATATYPE BOUND IRI URI BNODE RAND ABS CEIL FLOOR "
    "ROUND CONCAT STRLEN UCASE LCASE ENCODE_FOR_URI CONTAINS STRSTARTS STRENDS STRBEFORE "
    "STRAFTER YEAR MONTH DAY HOURS MINUTES SECONDS TIMEZONE TZ NOW UUID STRUUID MD5 SHA1 "
    "SHA256 SHA384 SHA512 COALESCE IF STRLANG STRLANGDIR STRDT SAMETERM ISIRI ISURI ISBLANK "
    "ISLITERAL ISNUMERIC ISTRIPLE TRIPLE SUBJECT PREDICATE OBJECT REGEX SUBSTR REPLACE COUNT "
    "SUM MIN MAX AVG SAMPLE GROUP_CONCAT ADJUST"
)
_KEYWORDS = frozenset((*_QUERY_FORMS, *_UPDATE_FORMS, *_OTHERS.split()))
_NAMES_OF_FORMS = "SELECT, CONSTRUCT, DESCRIBE or ASK"
_CLOSING = {"{": "}", "(": ")", "[": "]"}


def misspelling(tokens: list[Token], is_query: bool) -> tuple[str, Token] | None:
    """Return what is wrong with the first word that the grammar does not have, and its token.

    Parameters
    ----------
    tokens
        As :func:`rtask.sparql.lexer.tokenise` returns them.
    is_query
        Whether a query is expected; an update is then named as such.

    Examples
    --------
    >>> from rtask.sparql.lexer import tokenise
    >>> misspelling(tokenise("SELEC * { ?s ?p ?o }"), is_query=True)[0]
    "'SELEC' is no keyword; did you mean SELECT?"
    """
    if is_query:
        first = tokens[min(body_start(tokens), len(tokens) - 1)]
        word = first.text.upper()
        if word in _UPDATE_FORMS:
            return f"{first.text} begins an update; a query begins with {_NAMES_OF_FORMS}", first
        if word not in _QUERY_FORMS:
            near = _hint(word, _QUERY_FORMS)
            if first.kind == "word" and near:
                return f"{first.text!r} is no keyword{near}", first
            got = repr(first.text) if first.text else "the end"
            return f"a query begins with {_NAMES_OF_FORMS}, got {got}", first
    for token in tokens:
        if token.kind == "word" and token.text.upper() not in _KEYWORDS:
            return f"{token.text!r} is no keyword{_hint(token.text.upper(), _KEYWORDS)}", token
    return None


def misplaced(token: Token, expected: str) -> str:
    """Return what is wrong with a token of an update that is not one of those expected.

    Examples
    --------
    >>> from rtask.sparql.lexer import tokenise
    >>> misplaced(tokenise("INSER DATA { }")[0], "INSERT, DELETE")
    "'INSER' is no keyword; did you mean INSERT?"
    >>> misplaced(tokenise("ASK { }")[0], "INSERT, DELETE")
    'ASK begins a query; expected INSERT, DELETE'
    """
    if token.is_word(*_QUERY_FORMS):
        return f"{token.text} begins a query; expected {expected}"
    near = _hint(token.text.upper(), _KEYWORDS)
    if token.kind == "word" and token.text.upper() not in _KEYWORDS and near:
        return f"{token.text!r} is no keyword{near}"
    return f"expected {expected}, got {repr(token.text) if token.text else 'the end'}"


def unbalanced(tokens: list[Token]) -> tuple[str, Token] | None:
    """Return which bracket of a text has no partner, and its token.

    Where the text ends too early, the store's parser lists all that might come next.

    Examples
    --------
    >>> from rtask.sparql.lexer import tokenise
    >>> unbalanced(tokenise("SELECT * { ?s ?p ?o FILTER(?o > 2 }"))[0]
    "this '(' is never closed"
    >>> unbalanced(tokenise("ASK { ?s ?p ?o } }"))[0]
    "this '}' closes nothing"
    """
    opened: list[Token] = []
    for token in tokens:
        if token.kind == "mark" and token.text in _CLOSING:
            opened.append(token)
        elif token.kind == "mark" and token.text in _CLOSING.values():
            if not opened:
                return f"this {token.text!r} closes nothing", token
            if _CLOSING[opened[-1].text] != token.text:
                break
            opened.pop()
    return (f"this {opened[-1].text!r} is never closed", opened[-1]) if opened else None


def bare_slash(tokens: list[Token]) -> tuple[str, Token] | None:
    """Return how to write the first prefixed name with a slash, and its token.

    The grammar reads a slash behind a name as a step of a path, which neither a number nor a bare
    word can follow. The other forms in which people write terms take the slash as it is.

    Examples
    --------
    >>> from rtask.sparql.lexer import tokenise
    >>> bare_slash(tokenise("SELECT * { kb:object/7 ?p ?o }"))[0]
    'a slash in a prefixed name needs a backslash: kb:object\\\\/7'
    """
    for at, token in enumerate(tokens):
        if token.kind != "name":
            continue
        end = at + 1
        while tokens[end].start == tokens[end - 1].end and (
            tokens[end].kind in ("word", "number") or tokens[end].text in ("/", "-")
        ):
            end += 1
        rest = tokens[at + 1 : end]
        if len(rest) > 1 and rest[0].is_mark("/") and rest[1].text != "a":
            name = "".join(part.text for part in [token, *rest]).replace("/", "\\/")
            return f"a slash in a prefixed name needs a backslash: {name}", token
    return None


def _hint(word: str, keywords: tuple[str, ...] | frozenset[str]) -> str:
    near = difflib.get_close_matches(word, sorted(keywords), n=1)
    return f"; did you mean {near[0]}?" if near else ""
