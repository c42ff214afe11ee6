"""Identifiers use the field's nouns: vague words may only become rarer."""

import io
import keyword
import re
import tokenize
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
VAGUE = frozenset(
    {"one", "found", "told", "known", "thing", "things", "wanted", "kept", "said", "come"}
)
EXCEPTIONS = {
    **dict.fromkeys(("THING", "_THING", "ONE_OF"), "owl:Thing and owl:oneOf"),
    **dict.fromkeys(("FileNotFoundError", "ModuleNotFoundError"), "Python's own"),
    **dict.fromkeys(("PackageNotFoundError", "NotFound"), "names of libraries"),
    **dict.fromkeys(("thing", "things", "max_things", "things_untried"), "fields of messages"),
}
"""Names that are given from outside, and by whom."""
GENERATED = ("generated", "calls.py")
# Upper bounds on vague words per 1,000 names; lower them as the rooms improve.
MOST = {
    "rtask": 1.1,
    "endpoint": 0.7,
    "reasoner": 0.55,
    "grasp": 0.6,
    "features": 1.1,
    "simulate": 0.9,
}


def words(name: str) -> list[str]:
    """Return the words of an identifier in lower case."""
    return [w.lower() for w in re.findall(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+|\d+", name)]


def is_vague(name: str) -> bool:
    """Whether an identifier has a vague word."""
    return not VAGUE.isdisjoint(words(name))


def density(folder: Path) -> float:
    """Return the names with a vague word per 1,000 names of a folder's modules."""
    total = vague = 0
    for path in sorted(folder.rglob("*.py")):
        if not set(GENERATED).isdisjoint(path.parts):
            continue
        for token in tokenize.generate_tokens(io.StringIO(path.read_text("utf-8")).readline):
            if token.type == tokenize.NAME and not keyword.iskeyword(token.string):
                total += 1
                vague += token.string not in EXCEPTIONS and is_vague(token.string)
    return 1000 * vague / total


@pytest.mark.parametrize("room", MOST)
def test_vague_words_grow_no_commoner(room):
    assert density(ROOT / room) <= MOST[room]
