"""Patterns on disk yield what a Python set of the same quads yields.

The store writes numbers, dates, short texts and short blank node names into its keys as they are,
so terms are drawn around the bytes 0, 255 and 256.
"""

from __future__ import annotations

import random
from collections import defaultdict
from pathlib import Path

import pyoxigraph as ox
import pytest

from rtask.kb.store.embedded import EmbeddedStore

_XSD = "http://www.w3.org/2001/XMLSchema#"
_EDGES = (0, 1, -1, 254, 255, 256, 257, 510, 511, 512, 65_535, 65_536, -255, -256, -257)
_LETTERS = "a\x7f\x80ÿĀ\U0010ffff"


def _typed(text: str, datatype: str) -> ox.Literal:
    return ox.Literal(text, datatype=ox.NamedNode(_XSD + datatype))


def _literal(rng: random.Random) -> ox.Literal:
    number = rng.choice((*_EDGES, rng.randrange(-70_000, 70_000)))
    second = f"{rng.randrange(10, 60)}.{rng.randrange(1000):03d}"
    text = "".join(rng.choices(_LETTERS, k=rng.randrange(17)))
    return rng.choice(
        (
            _typed(str(number), "integer"),
            _typed(str(number / rng.choice((1, 4, 255, 256))), "double"),
            _typed(str(number / 4), "float"),
            _typed(f"{number}.{rng.randrange(300)}", "decimal"),
            _typed(rng.choice(("true", "false")), "boolean"),
            _typed(f"20{rng.randrange(10, 30)}-01-1{rng.randrange(9)}T01:02:{second}Z", "dateTime"),
            _typed(f"20{rng.randrange(10, 30)}-01-1{rng.randrange(9)}", "date"),
            _typed(f"PT{rng.randrange(600)}S", "dayTimeDuration"),
            _typed(f"P{rng.randrange(600)}M", "yearMonthDuration"),
            _typed(f"{rng.randrange(1000, 1600)}", "gYear"),
            _typed(text, "unknown"),
            ox.Literal(text),
            ox.Literal(text, language=rng.choice(("en", "de"))),
            ox.Literal("longer than a key " + text),
        )
    )


def _blank(rng: random.Random) -> ox.BlankNode:
    number = rng.choice((0xFE, 0xFF, 0x100, 0x1FF, 0xFFFF, rng.randrange(1, 2_000)))
    return ox.BlankNode(rng.choice((f"{number:x}", f"name{number % 20}")))


def _subject(rng: random.Random) -> ox.NamedNode | ox.BlankNode:
    return rng.choice((ox.NamedNode(f"urn:s{rng.randrange(30)}"), _blank(rng)))


def _quad(rng: random.Random) -> ox.Quad:
    inner = ox.Triple(_subject(rng), ox.NamedNode("urn:p"), _literal(rng))
    values = (_literal(rng), _blank(rng), inner, ox.NamedNode(f"urn:o{rng.randrange(600)}"))
    graphs = (ox.DefaultGraph(), _blank(rng), ox.NamedNode(f"urn:g{rng.randrange(4)}"))
    return ox.Quad(
        _subject(rng),
        ox.NamedNode(f"urn:p{rng.randrange(4)}"),
        rng.choices(values, (6, 2, 1, 1))[0],
        rng.choice(graphs),
    )


@pytest.mark.slow
@pytest.mark.parametrize("on_disk", [True, False])
def test_patterns_yield_what_a_set_yields(tmp_path: Path, on_disk: bool) -> None:
    rng = random.Random(3)
    store = EmbeddedStore(ox.Store(tmp_path) if on_disk else ox.Store())
    store.extend(_quad(rng) for _ in range(4_000))
    quads = list(store.raw)
    by_shape: dict[tuple[bool, ...], dict[tuple[object, ...], set[ox.Quad]]] = {}
    for number in range(1, 16):
        shape = tuple(bool(number >> bit & 1) for bit in range(4))
        found: dict[tuple[object, ...], set[ox.Quad]] = defaultdict(set)
        for quad in quads:
            found[_pattern(quad, shape)].add(quad)
        by_shape[shape] = found
    for quad in rng.sample(quads, 1_500):
        for shape, expected in by_shape.items():
            pattern = _pattern(quad, shape)
            if len(expected[pattern]) > 300:
                continue
            found_here = list(store.quads_for_pattern(*pattern))  # type: ignore[arg-type]
            assert len(found_here) == len(expected[pattern]), pattern
            assert set(found_here) == expected[pattern], pattern


def _pattern(quad: ox.Quad, shape: tuple[bool, ...]) -> tuple[object, ...]:
    terms = (quad.subject, quad.predicate, quad.object, quad.graph_name)
    return tuple(term if bound else None for term, bound in zip(terms, shape, strict=True))
