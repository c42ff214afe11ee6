"""Transitive closure along long paths: components first, then what each reaches, once per pair.

Tarjan 1972 for the strongly connected components; their successors are complete before them
(Purdom 1970, "A transitive closure algorithm").
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from reasoner.facts.arrays import Column, Keys, distinct, pack
from reasoner.rules.rule import Counter, Differ, Rule
from reasoner.terms.vocabulary import REFLEXIVE_PREDICATES


def transitive_property(rule: Rule) -> int | None:
    """Return the property that a rule makes transitive, None if it does something else."""
    if len(rule.body) != 2 or rule.head is None:
        return None
    first, two = rule.body
    # Either premise may be written first.
    if first.s == two.o:
        first, two = two, first
    # That the ends differ spares only what a reflexive property has anyway.
    if rule.conditions and (
        rule.conditions != (Differ(first.s, two.o),) or rule.head.p not in REFLEXIVE_PREDICATES
    ):
        return None
    is_path = first.p == two.p == rule.head.p and first.o == two.s
    ends = (first.s, first.o, two.o)
    is_open = max(ends) < 0 and len(set(ends)) == 3 and (rule.head.s, rule.head.o) == ends[::2]
    return rule.head.p if is_path and is_open else None


def reachable(column: Column, most: int, work: Counter | None = None) -> Keys | None:
    """Return all pairs that paths of one step or more connect, or None if there are too many.

    Parameters
    ----------
    most : int
        Bound on the number of pairs.
    work
        Counts the sets that are joined.

    Examples
    --------
    >>> keys = reachable(Column.of([1, 2, 3], [2, 3, 2]), 100)
    >>> list(Column(keys))
    [(1, 2), (1, 3), (2, 2), (2, 3), (3, 2), (3, 3)]
    """
    after: dict[int, list[int]] = {}
    for s, o in column:
        after.setdefault(s, []).append(o)
    component: dict[int, int] = {}
    reach: list[set[int]] = []
    subjects, objects, total = [], [], 0
    for number, members in enumerate(_components(after)):
        for member in members:
            component[member] = number
        # A member of a cycle reaches itself.
        pairs: set[int] = set(members) if len(members) > 1 else set()
        onward = {o for member in members for o in after.get(member, ())}
        pairs |= onward
        # The nearest come first: what they reach need not be followed again.
        covered: set[int] = set()
        for near in sorted(onward, key=component.__getitem__, reverse=True):
            if component[near] != number and near not in covered:
                covered |= reach[component[near]]
                if work is not None:
                    work.count(1 + len(reach[component[near]]) // 8)
        pairs |= covered
        reach.append(pairs)
        total += len(pairs) * len(members)
        # Asked while it grows: the pairs of a long chain would fill the memory first.
        if total > most:
            return None
        ids = np.fromiter(pairs, np.uint64, len(pairs))
        for member in members:
            subjects.append(np.full(len(ids), member, np.uint64))
            objects.append(ids)
    return distinct(pack(np.concatenate(subjects), np.concatenate(objects)))


def _components(after: dict[int, list[int]]) -> Iterator[list[int]]:
    """Yield strongly connected components, each after all that it leads to."""
    index: dict[int, int] = {}
    low: dict[int, int] = {}
    open_nodes: list[int] = []
    is_open: set[int] = set()
    for root in after:
        if root in index:
            continue
        # No recursion: a path may be longer than Python's stack is deep.
        work = [(root, iter(after[root]))]
        index[root] = low[root] = len(index)
        open_nodes.append(root)
        is_open.add(root)
        while work:
            node, rest = work[-1]
            step = next(rest, None)
            if step is None:
                work.pop()
                if work:
                    low[work[-1][0]] = min(low[work[-1][0]], low[node])
                if low[node] == index[node]:
                    members: list[int] = []
                    while not members or members[-1] != node:
                        members.append(open_nodes.pop())
                        is_open.discard(members[-1])
                    yield members
            elif step not in index:
                index[step] = low[step] = len(index)
                open_nodes.append(step)
                is_open.add(step)
                work.append((step, iter(after.get(step, ()))))
            elif step in is_open:
                low[node] = min(low[node], index[step])
