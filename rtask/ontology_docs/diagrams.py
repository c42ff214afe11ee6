"""Diagrams of a module as inline SVG: its class hierarchy, and which classes its relations join.

Both layouts are tables, which avoids needless crossings: the hierarchy has a column per level and a
row per class; each relation has a row, with its domain on the left and its range on the right.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from html import escape

import ontology
from rtask.ontology_docs.source import Module, prefixed
from rtask.ontology_docs.terms import Term, Vocabulary

__all__ = ["hierarchy", "relations"]

_RDFS, _OWL = ontology.PREFIXES["rdfs"], ontology.PREFIXES["owl"]
_CHARACTER, _ROW, _HEIGHT, _GAP, _MARGIN = 7.4, 30, 22, 44, 8
"""Pixels: a character's width, a row, a box, between columns, around."""

Link = Callable[[str], str | None]


@dataclass
class _Box:
    text: str
    x: float
    y: float
    width: float
    height: float = _HEIGHT
    link: str | None = None
    is_own: bool = True

    @property
    def middle(self) -> float:
        return self.y + self.height / 2

    def svg(self) -> str:
        kind = "own" if self.is_own else "other"
        drawn = (
            f'<rect class="{kind}" x="{self.x:.0f}" y="{self.y:.0f}" width="{self.width:.0f}"'
            f' height="{self.height:.0f}" rx="4"/>'
            f'<text x="{self.x + 7:.0f}" y="{self.middle + 4:.0f}">{escape(self.text)}</text>'
        )
        return f'<a href="{escape(self.link)}">{drawn}</a>' if self.link else drawn


def _width(text: str) -> float:
    return len(text) * _CHARACTER + 14


def _drawing(title: str, boxes: Iterable[_Box], lines: Iterable[str]) -> str:
    boxes = list(boxes)
    if not boxes:
        return ""
    width = max(box.x + box.width for box in boxes) + _MARGIN
    height = max(box.y + box.height for box in boxes) + _MARGIN
    body = "".join([*lines, *(box.svg() for box in boxes)])
    return (
        f'<svg role="img" aria-label="{escape(title)}" width="{width:.0f}" height="{height:.0f}"'
        f' viewBox="0 0 {width:.0f} {height:.0f}"><title>{escape(title)}</title>{body}</svg>'
    )


def hierarchy(vocabulary: Vocabulary, module: Module, link: Link) -> str:
    """Return the classes of a module below their direct superclasses; empty without classes.

    Parameters
    ----------
    link
        Address of a term's entry, ``None`` if it has none.
    """
    own = {t.iri for t in vocabulary.members(module) if "class" in t.kinds}
    parents = {iri: _parents(vocabulary.terms[iri]) for iri in own}
    for above in {iri for listed in parents.values() for iri in listed} - own:
        parents[above] = []
    level = _levels(parents)
    order = _rows(parents)
    texts = {iri: prefixed(iri) for iri in order}
    widths: dict[int, float] = defaultdict(float)
    for iri in order:
        widths[level[iri]] = max(widths[level[iri]], _width(texts[iri]))
    columns = {n: _MARGIN + sum(widths[m] + _GAP for m in range(n)) for n in widths}
    boxes = {
        iri: _Box(
            texts[iri],
            columns[level[iri]],
            _MARGIN + row * _ROW,
            _width(texts[iri]),
            link=link(iri),
            is_own=iri in own,
        )
        for row, iri in enumerate(order)
    }
    lines = [
        _elbow(boxes[above], boxes[iri], dashed=n > 0)
        for iri, listed in parents.items()
        for n, above in enumerate(listed)
    ]
    return _drawing(f"Class hierarchy of {module.title}", boxes.values(), lines)


def _parents(term: Term) -> list[str]:
    return [iri for iri in term.named(_RDFS + "subClassOf") if iri != term.iri]


def _levels(parents: dict[str, list[str]]) -> dict[str, int]:
    """Return the length of the longest path of superclasses above each class; cycles are cut."""
    level: dict[str, int] = {}

    def measure(iri: str, seen: frozenset[str]) -> int:
        if iri not in level:
            above = [p for p in parents[iri] if p not in seen]
            level[iri] = 1 + max((measure(p, seen | {iri}) for p in above), default=-1)
        return level[iri]

    for iri in sorted(parents):
        measure(iri, frozenset({iri}))
    return level


def _rows(parents: dict[str, list[str]]) -> list[str]:
    """Return all classes, each after the first of its parents, depth first."""
    children: dict[str, list[str]] = defaultdict(list)
    for iri, listed in parents.items():
        children[listed[0] if listed else ""].append(iri)
    order: dict[str, None] = {}
    for start in ["", *sorted(parents)]:  # the second pass adds classes that are part of a cycle
        stack = [start]
        while stack:
            iri = stack.pop()
            if iri not in order:
                if iri:
                    order[iri] = None
                stack += sorted(children[iri], reverse=True)
                children[iri] = []
    return list(order)


def _elbow(above: _Box, below: _Box, dashed: bool) -> str:
    start, end = above.x + above.width, below.x
    bend = end - _GAP / 3 if end > start else start + _GAP / 3
    style = ' class="also"' if dashed else ""
    path = f"M{end:.0f} {below.middle:.0f}H{bend:.0f}V{above.middle:.0f}H{start:.0f}"
    return f"<path{style} d='{path}'/>".replace("'", '"')


def relations(vocabulary: Vocabulary, module: Module, link: Link) -> str:
    """Return the object properties of a module between domain and range; empty without any."""
    rows: dict[str, list[Term]] = defaultdict(list)
    for term in vocabulary.members(module):
        if "object property" in term.kinds:
            rows[_end(vocabulary, term, "domain")].append(term)
    ends = {t.iri: _end(vocabulary, t, "range") for terms in rows.values() for t in terms}
    left = max((_width(domain) for domain in rows), default=0)
    label = max((_width(_label(t)) for terms in rows.values() for t in terms), default=0)
    boxes, lines, at = list[_Box](), list[str](), 0
    for domain, terms in sorted(rows.items()):
        top = _MARGIN + at * _ROW
        height = (len(terms) - 1) * _ROW + _HEIGHT
        boxes.append(_box(vocabulary, domain, (_MARGIN, top), (left, height), module, link))
        for term in terms:
            y, x = _MARGIN + at * _ROW, _MARGIN + left + label + 30
            text = ends[term.iri]
            boxes.append(_box(vocabulary, text, (x, y), (_width(text), _HEIGHT), module, link))
            lines.append(_arrow(_MARGIN + left, x, y + _HEIGHT / 2, _label(term), link(term.iri)))
            at += 1
    return _drawing(f"Relations of {module.title}", boxes, lines)


def _box(
    vocabulary: Vocabulary,
    text: str,
    place: tuple[float, float],
    size: tuple[float, float],
    module: Module,
    link: Link,
) -> _Box:
    iri = next((iri for iri in vocabulary.terms if prefixed(iri) == text), "")
    is_own = bool(iri) and vocabulary.terms[iri].module == module.name
    return _Box(text, *place, *size, link=link(iri) if iri else None, is_own=is_own)


def _end(vocabulary: Vocabulary, term: Term, side: str) -> str:
    """Return domain or range as text, its own or that of its inverse or super-property."""
    other = {"domain": "range", "range": "domain"}[side]
    if stated := term.values(_RDFS + side):
        return stated[0]
    inverse = _OWL + "inverseOf"
    users = vocabulary.used_by(term.iri)
    inverses = [*term.named(inverse), *(a.subject for a in users if a.predicate == inverse)]
    for iri in inverses:
        if iri in vocabulary.terms and (stated := vocabulary.terms[iri].values(_RDFS + other)):
            return stated[0]
    for iri in term.named(_RDFS + "subPropertyOf"):
        if iri in vocabulary.terms and (stated := vocabulary.terms[iri].values(_RDFS + side)):
            return stated[0]
    return "any"


def _label(term: Term) -> str:
    return term.name.partition(":")[2] or term.name


def _arrow(start: float, end: float, y: float, label: str, link: str | None) -> str:
    middle = (start + end) / 2
    text = f'<text class="edge" x="{middle:.0f}" y="{y - 4:.0f}">{escape(label)}</text>'
    text = f'<a href="{escape(link)}">{text}</a>' if link else text
    tip = f"M{start:.0f} {y:.0f}H{end - 1:.0f}M{end - 8:.0f} {y - 4:.0f}l7 4l-7 4"
    return f'<path d="{tip}"/>{text}'
