"""Rules in the graph: statements about each rule, and the rules that a change leaves.

The graph ``{base}graph/rules`` is one that queries see and that may be written like any other, by
those who have the right; what it says takes effect with the commit that says it.
"""

from __future__ import annotations

import datetime as dt
import re
from collections.abc import Iterable, Iterator
from itertools import chain
from urllib.parse import quote

from pyoxigraph import Literal, Quad

import ontology
from rtask.errors import ConflictError, DataError, UnknownTermError, nearest
from rtask.kb.rules.checking import check_rule, rule_error, tidy
from rtask.kb.rules.rule import Rule
from rtask.kb.store.graphs import Graphs
from rtask.kb.store.overlay import Overlay
from rtask.rdf.terms import RDF_TYPE, NamedNode, iri, literal, moment, stored_quad

__all__ = ["add", "blamed", "changed", "remove", "stored_rules"]

_RT = ontology.NS
_RULE = iri(_RT + "Rule")
_TEXT = iri(_RT + "ruleText")
_LABEL = iri(ontology.PREFIXES["rdfs"] + "label")
_COMMENT = iri(ontology.PREFIXES["rdfs"] + "comment")
_AUTHOR = iri(ontology.PREFIXES["prov"] + "wasAttributedTo")
_TIME = iri(ontology.PREFIXES["prov"] + "generatedAtTime")


def stored_rules(quads: Iterable[Quad]) -> list[Rule]:
    """Return the rules that the statements of the rules graph describe, sorted by label.

    Raises
    ------
    DataError
        A rule has two texts.
    """
    about: dict[NamedNode, dict[NamedNode, list[object]]] = {}
    for quad in quads:
        if isinstance(quad.subject, NamedNode):
            about.setdefault(quad.subject, {}).setdefault(quad.predicate, []).append(quad.object)
    rules = [_rule(name, facts) for name, facts in about.items() if _TEXT in facts]
    return sorted(rules, key=lambda rule: (rule.label, str(rule.iri)))


def _rule(name: NamedNode, facts: dict[NamedNode, list[object]]) -> Rule:
    texts = facts[_TEXT]
    if len(texts) > 1:
        raise DataError(f"the rule {name} has {len(texts)} texts; give it one rt:ruleText")

    def first(predicate: NamedNode) -> object:
        return min(facts.get(predicate, ()), key=str, default=None)

    label, author, time = first(_LABEL), first(_AUTHOR), first(_TIME)
    return Rule(
        label=getattr(label, "value", "") or re.split(r"[/#]", name.value)[-1],
        text=getattr(texts[0], "value", ""),
        comment=getattr(first(_COMMENT), "value", ""),
        iri=name,
        author=author if isinstance(author, NamedNode) else None,
        time=moment(time.value) if isinstance(time, Literal) else None,
    )


def changed(change: Overlay, graphs: Graphs) -> list[Rule] | None:
    """Return the rules after a pending change; ``None`` if the change concerns none.

    Raises
    ------
    ParseError
        A new rule cannot be used; gives line and column.
    """
    here = graphs.rules
    if not any(quad.graph_name == here for quad in chain(change.added, change.removed)):
        return None
    stored = change.store.quads_for_pattern(None, None, None, here)
    # By their text: a rule under a new label was checked before.
    before = {rule.text for rule in stored_rules(stored)}
    rules = stored_rules(change.quads(here))
    for rule in rules:
        if rule.text not in before:
            check_rule(rule, lambda term: _exists(change, term), _own_terms(change))
    return rules


def _exists(change: Overlay, term: NamedNode) -> bool:
    find = change.store.quads_for_pattern
    for quads in (
        find(term, None, None, None),
        find(None, term, None, None),
        find(None, None, term, None),
    ):
        if next(iter(quads), None) is not None:
            return True
    return any(term in (q.subject, q.predicate, q.object) for q in change.added)


def _own_terms(change: Overlay) -> Iterator[str]:
    """Yield the local names of RTASK's own terms."""
    defined = iri(ontology.PREFIXES["rdfs"] + "isDefinedBy")
    for quad in change.store.quads_for_pattern(None, defined, None, None):
        name = getattr(quad.subject, "value", "")
        if name.startswith(_RT):
            yield name.removeprefix(_RT)


def add(
    overlay: Overlay,
    rules: Iterable[Rule],
    graphs: Graphs,
    author: NamedNode | None,
    replace: bool,
) -> None:
    """Add statements about rules to a pending change; a rule that is there already stays as it is.

    Raises
    ------
    ConflictError
        There is another rule of that label, and ``replace`` is not given.
    """
    here, now = graphs.rules, dt.datetime.now(dt.UTC)
    existing = {rule.iri: rule for rule in stored_rules(overlay.quads(here))}
    labels = {rule.label: rule for rule in existing.values()}
    for rule in rules:
        check_rule(rule, lambda term: _exists(overlay, term), _own_terms(overlay))
        rule = tidy(rule)
        name = rule_iri(graphs, rule.label)
        # By label too: a rule that was loaded from a file may have any IRI.
        old = existing.get(name) or labels.get(rule.label)
        if old is not None:
            if (old.text, old.comment) == (rule.text, rule.comment):
                continue
            if not replace:
                raise ConflictError(
                    f"there is another rule {old.label!r}; replace it (rtask rules add --replace, "
                    "replace=True) or choose another label",
                    rule=old.label,
                )
            assert old.iri is not None
            _withdraw(overlay, graphs, old.iri)
        for predicate, value in _statements(rule, author, now):
            overlay.add(stored_quad(Quad(name, predicate, value, here)))


def _statements(
    rule: Rule, author: NamedNode | None, now: dt.datetime
) -> Iterator[tuple[NamedNode, NamedNode | Literal]]:
    yield RDF_TYPE, _RULE
    yield _LABEL, literal(rule.label)
    yield _TEXT, literal(rule.text)
    if rule.comment:
        yield _COMMENT, literal(rule.comment)
    if author is not None:
        yield _AUTHOR, author
    yield _TIME, literal(now)


def remove(overlay: Overlay, names: Iterable[str], graphs: Graphs) -> None:
    """Remove rules, named by label or IRI, from a pending change.

    Raises
    ------
    UnknownTermError
        There is no such rule.
    """
    for name in names:
        _withdraw(overlay, graphs, find(stored_rules(overlay.quads(graphs.rules)), name))


def find(rules: list[Rule], name: str) -> NamedNode:
    """Return the IRI of a rule, given its label or IRI.

    Raises
    ------
    UnknownTermError
        There is no such rule.
    """
    for rule in rules:
        if rule.iri is not None and name in (rule.label, rule.iri.value):
            return rule.iri
    hint = nearest(name, [rule.label for rule in rules])
    raise UnknownTermError(f"there is no rule {name!r}{hint}", rule=name)


def _withdraw(overlay: Overlay, graphs: Graphs, name: NamedNode) -> None:
    for quad in [quad for quad in overlay.quads(graphs.rules) if quad.subject == name]:
        overlay.remove(quad)


def rule_iri(graphs: Graphs, label: str) -> NamedNode:
    """Return the IRI of the rule with a label.

    >>> rule_iri(Graphs("urn:lab/"), "Full mugs are heavy").value
    'urn:lab/rule/full-mugs-are-heavy'
    """
    return iri(f"{graphs.base}rule/" + quote(re.sub(r"\s+", "-", label.strip().lower()), safe=""))


def blamed(rules: Iterable[Rule], before: Iterable[Rule], error: Exception) -> DataError:
    """Return the reasoner's refusal of several rules as an error that names one of them.

    Negation in a circle is found in all rules together; the new one among them is to blame.
    """
    old = {rule.text for rule in before}
    new = [rule for rule in rules if rule.text not in old] or list(rules)
    return rule_error(new[0], error)
