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
# Upper bounds on vague words per 1,000 names; lower them as the rooms improve.
MOST = {
    "rtask": 3.0,
    "endpoint": 1.2,
    "reasoner": 2.6,  # owl:Thing and owl:oneOf are OWL's own
    "grasp": 1.0,
    "features": 2.2,
    "simulate": 1.6,
}


def words(name: str) -> list[str]:
    """Return the words of an identifier in lower case."""
    return [w.lower() for w in re.findall(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+|\d+", name)]


def density(folder: Path) -> float:
    """Return the names with a vague word per 1,000 names of a folder's modules."""
    total = vague = 0
    for path in sorted(folder.rglob("*.py")):
        if "generated" in path.parts:
            continue
        for token in tokenize.generate_tokens(io.StringIO(path.read_text("utf-8")).readline):
            if token.type == tokenize.NAME and not keyword.iskeyword(token.string):
                total += 1
                vague += not VAGUE.isdisjoint(words(token.string))
    return 1000 * vague / total


@pytest.mark.parametrize("room", MOST)
def test_vague_words_grow_no_commoner(room):
    assert density(ROOT / room) <= MOST[room]
