"""Large changes: whole relations joined at once, round by round, to the fixpoint.

Semi-naive evaluation over sorted arrays. Rules that need a value at a time (comparisons of users'
rules, negation, literals of one value in several spellings) are left to the worklist.
"""

from __future__ import annotations

import itertools
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator

import numpy as np
from numpy.typing import NDArray

from reasoner.facts import arrays
from reasoner.facts.arrays import NO_KEYS, Column, Ids, Keys, TooManyRowsError
from reasoner.facts.equality import Equality, ranking
from reasoner.fixpoint.ownership import Ownership
from reasoner.fixpoint.paths import reachable, transitive_property
from reasoner.rules.rule import Atom, Clash, Condition, Differ, InDatatype, Rule, Step, arrange
from reasoner.rules.strata import Program
from reasoner.rules.work import ClosureTooLargeError, Work
from reasoner.terms.dictionary import Dictionary, Fact
from reasoner.terms.vocabulary import (
    LITERAL,
    REFLEXIVE_PREDICATES,
    SAME,
    SCHEMA_CLASSES,
    SCHEMA_PREDICATES,
    TYPE,
)

Table = dict[int, Ids]
"""Bindings of rows of solutions: one array per variable, all of one length."""

_LITERAL = np.uint64(LITERAL)

LONG_PATHS = 3
"""Rounds after which transitive properties are closed along paths: each round doubles the length,
but joins a pair as often as there are places to cut its path.
"""


class Bulk:
    """A fixpoint over columns.

    Attributes
    ----------
    columns : dict of int to Column
        Facts on representatives, by property.
    touched_schema : bool
        Schema facts or equalities of terms in rules were derived: the rules are to be compiled
        anew.
    """

    def __init__(
        self,
        terms: Dictionary,
        equality: Equality,
        max_facts: int,
        refusal: Callable[[int], ClosureTooLargeError],
        work: Work | None = None,
        ownership: Ownership | None = None,
    ) -> None:
        self.columns: dict[int, Column] = {}
        self.touched_schema = False
        self._terms = terms
        self._equality = equality
        self._max_facts = max_facts
        self._refusal = refusal
        self._rows = arrays.MAX_ROWS
        self._work = work
        self._ownership = ownership or Ownership(None, terms)
        self._widened: set[int] = set()
        self._merged: Ids = arrays.NO_KEYS
        self._representatives: Ids = arrays.NO_KEYS

    def load(self, facts: Iterable[Fact]) -> None:
        """Add facts without deriving; sameAs merges its ends."""
        for p, column in arrays.columns_of(facts).items():
            self.columns[p] = Column(_proper(p, column.keys))
        if SAME in self.columns:
            self._unite(self.columns.pop(SAME).keys)
        if self._equality:
            self._rewrite()

    def adopt(self, columns: dict[int, Column]) -> None:
        """Begin with columns of representatives, without deriving."""
        self.columns = dict(columns)

    def run(self, rules: Iterable[Rule], constants: frozenset[int]) -> list[Rule]:
        """Derive all that follows; return the rules that are left to the worklist."""
        plain: list[Rule] = []
        left: list[Rule] = []
        for rule in rules:
            (plain if self._is_plain(rule) else left).append(rule)
        hierarchy = _Hierarchy(plain)
        others = [rule for rule in plain if not hierarchy.covers(rule)]
        delta = dict(self.columns)
        for number in itertools.count():
            if not delta:
                break
            pending: dict[int, list[Keys]] = defaultdict(list)
            if TYPE in delta:
                pending[TYPE].append(hierarchy.above(delta[TYPE].keys))
            # Round by round, a chain of n links takes about log n rounds that join all pairs again:
            # a search from each end finds what long chains reach at once.
            if number == LONG_PATHS:
                paths = {p for rule in others if (p := transitive_property(rule)) is not None}
                others = [rule for rule in others if transitive_property(rule) is None]
            if number >= LONG_PATHS:
                for p in paths & delta.keys():
                    pairs = reachable(self.columns[p], self._max_facts, self._work)
                    if pairs is None:
                        raise self._refusal(p)
                    pending[p].append(_proper(p, pairs))
            # Semi-naive: only what uses a fact of the last round can be new.
            tables = self._changed(others, delta) if number else self._all(others)
            for rule, table in tables:
                self._conclude(rule, table, pending)
                self._bound(pending)
            delta = self._absorb(pending)
            united = self._unite(np.concatenate(pending.get(SAME, [NO_KEYS])))
            if united:
                self.touched_schema |= not united.isdisjoint(constants)
                delta = self._rewrite(delta)
            if sum(map(len, self.columns.values())) > self._max_facts:
                largest = max(delta, key=lambda p: len(delta[p]), default=TYPE)
                raise self._refusal(largest)
        return left

    def _bound(self, matches: dict[int, list[Keys]]) -> None:
        """Keep what one round gathers within memory: the same heads arrive again and again."""
        if self._work is not None:
            self._work.count(1)
        for p, parts in matches.items():
            if len(parts) > 1 and sum(map(len, parts)) > arrays.MAX_ROWS:
                parts[:] = [arrays.distinct(np.concatenate(parts))]
                if len(parts[0]) > self._max_facts:
                    raise self._refusal(p)

    def suspects(self, checks: Iterable[Rule], program: Program) -> list[Rule]:
        """Return the checks that have an instance, or that columns cannot tell about."""
        return [
            rule
            for rule in checks
            if not self._is_plain(rule)
            or any(program.level_of(atom) for atom in rule.body)
            or any(len(next(iter(table.values()), ())) for _, table in self._all([rule]))
        ]

    # Solutions of rules.

    def _is_plain(self, rule: Rule) -> bool:
        """Tell whether whole columns can be joined for a rule."""
        if not rule.body or not all(
            isinstance(c, Differ | InDatatype | Clash) for c in rule.conditions
        ):
            return False
        if any(not atom.variables or (atom.p == TYPE and atom.o < 0) for atom in rule.body):
            return False
        bound = set(rule.body[0].variables)
        for step in arrange(rule.body[1:], (), rule.body[0].variables):
            if isinstance(step, Atom):
                if not step.variables & bound:
                    return False  # a cartesian product
                bound |= step.variables
        if not self._terms.has_variants:
            return True
        ends = [atom.o for atom in rule.body if atom.p != TYPE]
        return len(ends) == len(set(ends)) and not any(o >= LITERAL for o in ends)

    def _all(self, rules: Iterable[Rule]) -> Iterator[tuple[Rule, Table]]:
        """Yield the solutions of each rule, starting from its smallest atom."""
        for rule in rules:
            if all(self._size(atom) for atom in rule.body):
                # Joins only grow from the pairs that they start with.
                start = min(rule.body, key=self._size)
                for table in self._solutions(rule, start, self._pairs(start)):
                    yield rule, table

    def _changed(
        self, rules: Iterable[Rule], delta: dict[int, Column]
    ) -> Iterator[tuple[Rule, Table]]:
        """Yield the solutions that use at least one new fact."""
        for rule in rules:
            # An atom that a body names twice would give the same solutions twice.
            for atom in dict.fromkeys(rule.body):
                new = delta.get(atom.p)
                if new is not None and all(self._size(other) for other in rule.body):
                    pairs = self._pairs(atom, new)
                    for table in self._solutions(rule, atom, pairs):
                        yield rule, table

    def _size(self, atom: Atom) -> int:
        column = self.columns.get(atom.p)
        if column is None:
            return 0
        return len(column.subjects(atom.o)) if atom.o >= 0 else len(column)

    def _pairs(self, atom: Atom, column: Column | None = None) -> tuple[Ids, Ids]:
        """Return subjects and objects of the facts that match an atom."""
        column = self.columns[atom.p] if column is None else column
        if atom.o >= 0:
            subjects = column.subjects(atom.o)
            objects = np.full(len(subjects), atom.o, np.uint64)
        else:
            subjects, objects = arrays.upper(column.keys), arrays.lower(column.keys)
        keep = np.ones(len(subjects), bool)
        if atom.s >= 0:
            keep &= subjects == np.uint64(atom.s)
        if atom.s == atom.o:
            keep &= subjects == objects
        return subjects[keep], objects[keep]

    def _solutions(self, rule: Rule, start: Atom, pairs: tuple[Ids, Ids]) -> Iterator[Table]:
        """Yield the solutions that start from pairs, in parts if they are too many."""
        subjects, objects = pairs
        if not len(subjects):
            return
        is_one = len(subjects) == 1
        self._rows = arrays.MAX_ROWS_OF_ONE if is_one else arrays.MAX_ROWS
        try:
            yield self._solve(rule, start, pairs)
        except TooManyRowsError:
            half = len(subjects) // 2
            if not half:
                name = rule.name.removeprefix("rule:")
                raise ClosureTooLargeError(
                    f"one fact gives more than {self._rows} combinations in the rule {name}",
                    rule=name,
                ) from None
            yield from self._solutions(rule, start, (subjects[:half], objects[:half]))
            yield from self._solutions(rule, start, (subjects[half:], objects[half:]))

    def _solve(self, rule: Rule, start: Atom, pairs: tuple[Ids, Ids]) -> Table:
        table: Table = {v: ids for v, ids in zip((start.s, start.o), pairs, strict=True) if v < 0}
        rest = list(rule.body)
        rest.remove(start)
        steps = arrange(rest, rule.conditions, start.variables)
        for step in steps:
            table = self._step(step, table)
            if self._work is not None and isinstance(step, Atom):
                self._work.spend_rows(len(next(iter(table.values()), ())), rule.body)
        return table

    def _step(self, step: Step, table: Table) -> Table:
        if not isinstance(step, Atom):
            return _rows(table, self._test(step, table))
        column = self.columns[step.p]
        s, o = table.get(step.s), table.get(step.o)
        length = len(next(iter(table.values())))
        if step.o >= 0:
            o = np.full(length, step.o, np.uint64)
        if step.s >= 0:
            s = np.full(length, step.s, np.uint64)
        if s is not None and o is not None:
            return _rows(table, arrays.is_in(arrays.pack(s, o), column.keys))
        if s is not None:
            index, targets = arrays.expand(column.keys, s, self._rows)
            return {**_rows(table, index), step.o: targets}
        assert o is not None
        index, targets = arrays.expand(column.inverse, o, self._rows)
        return {**_rows(table, index), step.s: targets}

    def _test(self, condition: Condition, table: Table) -> NDArray[np.bool_]:
        if isinstance(condition, Differ):
            return np.not_equal(table[condition.left], table[condition.right])
        if isinstance(condition, Clash):
            a, b = table[condition.left], table[condition.right]
            # Spellings of one value are rare: what differs is looked at again by the worklist.
            return ((a >= _LITERAL) | (b >= _LITERAL)) & np.not_equal(a, b)
        assert isinstance(condition, InDatatype)
        values, place = np.unique(table[condition.variable], return_inverse=True)
        holds = [condition.holds_of(value, self._terms) for value in values.tolist()]
        tested: NDArray[np.bool_] = np.array(holds, bool)[place]
        return tested

    # Heads.

    def _conclude(self, rule: Rule, table: Table, pending: dict[int, list[Keys]]) -> None:
        head = rule.head
        assert head is not None
        length = len(next(iter(table.values()), ()))
        if not length:
            return
        s, o = (table[x] if x < 0 else np.full(length, x, np.uint64) for x in (head.s, head.o))
        # RDF has no statement about a literal; what holds of each term itself is not stored.
        keep = s < _LITERAL
        if head.p in REFLEXIVE_PREDICATES:
            keep &= s != o
        if head.p == SAME:
            keep &= o < _LITERAL
        p = self._equality.find(head.p)
        keys = arrays.distinct(self._represent(arrays.pack(s[keep], o[keep])))
        pending[p].append(self._permitted(keys) if self._ownership.asks(rule) else keys)

    def _permitted(self, keys: Keys) -> Keys:
        """Return the pairs that a shared value of a key may make one."""
        equality, may_merge = self._equality, self._ownership.may_merge
        pairs = zip(arrays.upper(keys).tolist(), arrays.lower(keys).tolist(), strict=True)
        permitted: Keys = keys[np.array([may_merge(equality, a, b) for a, b in pairs], bool)]
        return permitted

    def _absorb(self, pending: dict[int, list[Keys]]) -> dict[int, Column]:
        """Merge candidates into the columns; return what is new."""
        delta: dict[int, Column] = {}
        for p, candidates in pending.items():
            if p == SAME:
                continue
            old = self.columns[p].keys if p in self.columns else NO_KEYS
            new = arrays.distinct(np.concatenate(candidates))
            new = new[~arrays.is_in(new, old)]
            if len(new):
                self.columns[p] = Column(arrays.merge(old, new))
                delta[p] = Column(new)
                self._note_schema(p, new)
        return delta

    def _note_schema(self, p: int, new: Keys) -> None:
        if p in SCHEMA_PREDICATES:
            self.touched_schema = True
        elif p == TYPE and not self.touched_schema:
            classes = np.array(sorted(SCHEMA_CLASSES), np.uint64)
            self.touched_schema = bool(arrays.is_in(arrays.lower(new), classes).any())

    # Equality.

    def _unite(self, pairs: Keys) -> set[int]:
        """Merge pairs of terms; return the terms that were given up for another."""
        losers = set()
        # Equal literals are known by their values.
        pairs = pairs[arrays.lower(pairs) < LITERAL]
        for key in arrays.connecting(pairs).tolist():
            a, b = self._equality.find(key >> 32), self._equality.find(key & 0xFFFFFFFF)
            if a == b:
                continue
            winner, loser = sorted((a, b), key=lambda x: ranking(x, self._terms))
            if self._work is not None:
                members = self._equality.members
                self._work.count(len(members(a)) + len(members(b)))
            if self._ownership.join(self._equality, winner, loser):
                self._widened.add(winner)
            self._equality.union(winner, loser)
            losers.add(loser)
        return losers

    def _represent(self, keys: Keys) -> Keys:
        """Put representatives into keys; the order is lost."""
        if not len(self._merged):
            return keys

        def replaced(ids: Ids) -> Ids:
            place = np.searchsorted(self._merged, ids)
            place[place == len(self._merged)] = 0
            out: Ids = np.array(ids)
            is_merged = np.equal(self._merged[place], ids)
            out[is_merged] = self._representatives[place][is_merged]
            return out

        return arrays.pack(replaced(arrays.upper(keys)), replaced(arrays.lower(keys)))

    def _rewrite(self, delta: dict[int, Column] | None = None) -> dict[int, Column]:
        """Put representatives in all columns; return what is new, with what was new before."""
        merged = sorted(m for _, members in self._equality.classes() for m in members)
        self._merged = np.array(merged, np.uint64)
        self._representatives = np.array([*map(self._equality.find, merged)], np.uint64)
        fresh: dict[int, list[Keys]] = defaultdict(list)
        for p in list(self.columns):
            before = self.columns[p].keys
            after = self._represent(before)
            moved = after != before
            if self._equality.find(p) != p:
                del self.columns[p]
                fresh[self._equality.find(p)].append(arrays.distinct(after))
            elif moved.any():
                self.columns[p] = Column(before[~moved])
                fresh[p].append(arrays.distinct(after[moved]))
            if delta and p in delta:
                keys = self._represent(delta[p].keys)
                fresh[self._equality.find(p)].append(arrays.distinct(keys))
        for p, keys in self._about_widened():
            fresh[p].append(keys)
        changed = {p: arrays.distinct(np.concatenate(keys)) for p, keys in fresh.items()}
        for p, keys in changed.items():
            changed[p] = keys = _proper(p, keys)
            current = self.columns[p].keys if p in self.columns else NO_KEYS
            self.columns[p] = Column(arrays.merge(current, keys[~arrays.is_in(keys, current)]))
            self._note_schema(p, keys)
        return {p: Column(keys) for p, keys in changed.items() if len(keys)}

    def _about_widened(self) -> Iterator[tuple[int, Keys]]:
        """Yield facts about classes that gained owners, of whose known facts keys may tell more."""
        if not self._widened:
            return
        ids = np.array([*map(self._equality.find, self._widened)], np.uint64)
        self._widened.clear()
        for p, column in self.columns.items():
            keys = column.keys
            hit = np.isin(arrays.upper(keys), ids) | np.isin(arrays.lower(keys), ids)
            if hit.any():
                yield p, keys[hit]


def _proper(p: int, keys: Keys) -> Keys:
    """Leave out what is true of every class and property."""
    if p in REFLEXIVE_PREDICATES:
        return keys[np.not_equal(arrays.upper(keys), arrays.lower(keys))]
    return keys


def _rows(table: Table, index: NDArray[np.bool_] | NDArray[np.intp]) -> Table:
    return {v: ids[index] for v, ids in table.items()}


class _Hierarchy:
    """Rules from a class to a class, closed, so that one join climbs all the way up."""

    def __init__(self, rules: Iterable[Rule]) -> None:
        edges: dict[int, set[int]] = defaultdict(set)
        self._rules = set()
        for rule in rules:
            edge = _class_edge(rule)
            if edge is not None:
                self._rules.add(rule)
                edges[edge[0]].add(edge[1])
        above = {c: _climb(edges, c) - {c} for c in tuple(edges)}
        self._deepest = max(map(len, above.values()), default=0)
        pairs = [(c, d) for c, classes in above.items() for d in classes]
        self._above = Column.of([c for c, _ in pairs], [d for _, d in pairs]).keys

    def covers(self, rule: Rule) -> bool:
        """Tell whether the rule is part of the hierarchy."""
        return rule in self._rules

    def above(self, types: Keys) -> Keys:
        """Return the types that follow from types."""
        out = []
        for part in np.array_split(types, 1 + len(types) * self._deepest // arrays.MAX_ROWS):
            index, classes = arrays.expand(self._above, arrays.lower(part))
            out.append(arrays.distinct(arrays.pack(arrays.upper(part)[index], classes)))
        return np.concatenate(out)


def _class_edge(rule: Rule) -> tuple[int, int] | None:
    if len(rule.body) != 1 or rule.conditions or rule.head is None:
        return None
    below, above = rule.body[0], rule.head
    if below.p == above.p == TYPE and below.s == above.s < 0 and min(below.o, above.o) >= 0:
        return below.o, above.o
    return None


def _climb(edges: dict[int, set[int]], start: int) -> set[int]:
    seen: set[int] = set()
    queue = [start]
    while queue:
        for d in edges.get(queue.pop(), ()):
            if d not in seen:
                seen.add(d)
                queue.append(d)
    return seen
