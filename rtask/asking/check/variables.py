"""Variables that occur once, are never bound, or do not connect the groups of a query."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Iterator
from dataclasses import replace

from rtask.asking.check.findings import Edit, Finding, Repair
from rtask.asking.check.naming.names import likeness, words_of
from rtask.asking.check.syntax.outline import Group, Node, Outline
from rtask.asking.check.vocabulary import local
from rtask.rdf.terms import RDF_TYPE

__all__ = ["check_variables"]

_NEAR = 0.6


def check_variables(outline: Outline) -> Iterator[Finding]:
    """Yield the faults of a query that its variables show."""
    bound = _bound(outline)
    used = _used(outline)
    counts = Counter(node.value for node in (*bound, *used))
    shown = {node.value for node in (*outline.projected, *outline.defined)}
    names = {node.value for node in bound} | {node.value for node in outline.defined}
    yield from _unbound(outline, bound, names, counts)
    for inner in outline.inner:
        yield from _unbound_inside(inner)
    yield from _once(outline, bound, counts, shown)
    yield from _slips(outline, bound, _mentioned(bound, used), counts, shown)
    yield from _grouping(outline)
    if not any(_is_loose(group) for group in outline.body.walk()):
        yield from _bridges(outline)


def as_written(name: str) -> str:
    """Return the name of a variable as the text writes it; those of sub-selects have a number."""
    return name.partition(" ")[0]


def _is_loose(group: Group) -> bool:
    """Return whether a group binds variables in ways that are not followed here."""
    return group.role == "service"


def _bound(outline: Outline) -> list[Node]:
    """Return the variables that patterns, BIND and VALUES bind, one for each mention."""
    binding: list[Node] = []
    for group in outline.body.walk():
        for edge in group.edges:
            binding += edge.variables
        binding += [node for node, _ in group.binds]
        binding += [node for node, _ in group.values]
        if group.graph is not None and group.graph.kind == "variable":
            binding.append(group.graph)
    return binding


def _used(outline: Outline) -> list[Node]:
    reading = list(outline.mentioned)
    for group in outline.body.walk():
        reading += [node for nodes in group.filters for node in nodes]
        reading += [node for _, nodes in group.binds for node in nodes]
    return reading


def _mentioned(bound: list[Node], used: list[Node]) -> Counter[str]:
    """Return in how many places of the text each variable stands.

    The subject of several patterns after each other is written once.
    """
    places = {(node.value, node.start) for node in (*bound, *used)}
    return Counter(name for name, _ in places)


def _unbound(
    outline: Outline, bound: list[Node], names: set[str], counts: Counter[str]
) -> Iterator[Finding]:
    """Yield the variables that are shown, tested or sorted by, and that nothing binds."""
    asked = [*outline.projected, *outline.mentioned]
    places = {node.value: node for node in bound if node.start < node.end}
    for group in outline.body.walk():
        asked += [node for nodes in group.filters for node in nodes]
    if outline.form == "DESCRIBE":
        return
    aliases = {node.value for node in outline.defined} - set(places)
    for node in asked:
        if node.value in names or node.start == node.end:
            continue
        near = max(names - aliases, key=lambda name: likeness(node.value, name), default="")
        repairs = _renamed(node, near) if likeness(node.value, near) >= 0.5 else ()
        if repairs and counts[near] == 1 and near in places:
            repairs = _renamed(places[near], node.value)  # the pattern is the one misspelt
        words = f"?{as_written(node.value)} is never bound: no pattern mentions it"
        yield Finding("unbound-variable", "likely", node.start, node.end, words, repairs)


def _unbound_inside(inner: Outline) -> Iterator[Finding]:
    """Yield the variables that a sub-select shows and does not bind, though others may."""
    bound = _bound(inner)
    names = {node.value for node in bound} | {node.value for node in inner.defined}
    counts = Counter(node.value for node in (*bound, *_used(inner)))
    asked = Outline(inner.form, inner.body, projected=inner.projected, defined=inner.defined)
    for finding in _unbound(asked, bound, names, counts):
        yield replace(finding, words=finding.words + " of its sub-select")


def _once(
    outline: Outline, bound: list[Node], counts: Counter[str], shown: set[str]
) -> Iterator[Finding]:
    """Yield the variables that occur once and are spelt much like another.

    A variable that occurs once is a usual way to say "something", so that alone is no fault.
    """
    if outline.selects_all:
        return
    others = {as_written(name) for name in counts if not name.startswith((" ", "_:"))}
    explained = _named_after_patterns(outline)
    for node in bound:
        name = as_written(node.value)
        if counts[node.value] > 1 or node.value in shown or node.value in explained:
            continue
        if name.startswith((" ", "_:")) or len(name) < 3:
            continue
        near = max(others - {name}, key=lambda o: (likeness(name, o), o), default="")
        if near and likeness(name, near) >= _NEAR and _differs_little(name, near):
            words = f"?{name} occurs once and is not shown; ?{near} is spelt much like it"
            yield Finding("used-once", "likely", node.start, node.end, words, _renamed(node, near))


def _named_after_patterns(outline: Outline) -> set[str]:
    """Return the variables whose words are all those of a property or class beside them.

    ``?minOpening`` of ``rt:minOpening`` is no misspelt ``?maxOpening``.
    """
    explained: set[str] = set()
    for group in outline.body.walk():
        for edge in group.edges:
            terms = [step.node.value for step in edge.steps]
            if edge.object.kind == "iri":
                terms.append(edge.object.value)
            known = {word for iri in terms for word in words_of(local(iri))}
            explained.update(
                node.value
                for node in edge.variables
                if known.issuperset(
                    word for word in words_of(as_written(node.value)) if not word.isdigit()
                )
            )
    return explained


def _slips(
    outline: Outline,
    bound: list[Node],
    mentioned: Counter[str],
    counts: Counter[str],
    shown: set[str],
) -> Iterator[Finding]:
    """Yield the subjects of several patterns that are written once, and like a slip of another."""
    if outline.selects_all:
        return
    once = {
        node.value: node for node in bound
        if counts[node.value] > 1 and mentioned[node.value] == 1 and node.value not in shown
        and not node.value.startswith((" ", "_:"))
    }  # fmt: skip
    for name, node in once.items():
        near = next((other for other in counts if _is_slip(name, other)), None)
        if near is not None:
            words = (
                f"?{as_written(name)} is written once and is not shown; "
                f"?{as_written(near)} is spelt much like it"
            )
            yield Finding("used-once", "likely", node.start, node.end, words, _renamed(node, near))


def _is_slip(name: str, other: str) -> bool:
    """Return whether two names differ by a letter left out or two changed with each other.

    >>> _is_slip("graps", "grasp"), _is_slip("gasp", "grasp"), _is_slip("grasps", "grasp")
    (True, True, False)
    >>> _is_slip("task2", "task")
    False
    """
    if len(name) == len(other):
        at = [i for i, (a, b) in enumerate(zip(name, other, strict=True)) if a != b]
        return (
            len(at) == 2 and at[1] == at[0] + 1
            and name[at[0]] + name[at[1]] == other[at[1]] + other[at[0]]
        )  # fmt: skip
    short, long = sorted((name, other), key=len)
    if len(long) != len(short) + 1 or len(short) < 4 or long == short + "s":
        return False
    dropped = next(
        (i for i, (a, b) in enumerate(zip(short, long, strict=False)) if a != b), len(short)
    )
    return long[:dropped] + long[dropped + 1 :] == short and long[dropped].isalpha()


def _differs_little(name: str, other: str) -> bool:
    """Return whether two names are two spellings of one, by a letter or two of a long name.

    A number or letter behind a name tells two things apart, and so does a word: ``?frame2``,
    ``?sizeX`` and ``?sizeY``.

    >>> _differs_little("rbot", "robot"), _differs_little("frame2", "frame")
    (True, False)
    >>> _differs_little("viewOf", "view"), _differs_little("reocgnitionn", "recognition")
    (False, True)
    """
    if name.strip("0123456789") == other.strip("0123456789"):
        return False
    if len(words_of(name)) != len(words_of(other)) or name[:-1] == other[:-1]:
        return False
    longest = max(len(name), len(other))
    if longest < 4:
        return False  # ?at and ?act are two abbreviations
    return _distance(name.lower(), other.lower()) <= (1 if longest < 9 else 2)


def _distance(name: str, other: str) -> int:
    """Return how many letters to leave out, add, change or swap with a neighbour, from 0 to 3.

    The optimal string alignment distance; what is more than 2 is 3.
    """
    if abs(len(name) - len(other)) > 2:
        return 3
    rows = [list(range(len(other) + 1))]
    for i, letter in enumerate(name, start=1):
        row = [i]
        for j, mate in enumerate(other, start=1):
            cost = min(row[j - 1] + 1, rows[-1][j] + 1, rows[-1][j - 1] + (letter != mate))
            if i > 1 and j > 1 and (letter, name[i - 2]) == (other[j - 2], mate):
                cost = min(cost, rows[-2][j - 2] + 1)
            row.append(cost)
        rows.append(row)
    return min(rows[-1][-1], 3)


def _renamed(node: Node, name: str) -> tuple[Repair, ...]:
    text = "?" + as_written(name)
    return (Repair(f"write {text}", (Edit(node.start, node.end, text),)),)


def _grouping(outline: Outline) -> Iterator[Finding]:
    """Yield the plain variables of a grouped SELECT that are not grouped by."""
    if outline.grouped is None or not outline.grouped:
        return
    grouped = {node.value for node in outline.grouped}
    for node in outline.projected:
        if node.value not in grouped:
            words = f"?{as_written(node.value)} is shown and not grouped by"
            last = outline.grouped[-1].end
            repair = Repair(
                f"group by ?{as_written(node.value)} too", (Edit(last, last, f" ?{node.value}"),)
            )
            yield Finding("not-grouped", "certain", node.start, node.end, words, (repair,))


class _Connections:
    """Which variables of a query its patterns connect, as sets that only grow together.

    Parameters
    ----------
    outline
        Of the query.
    """

    _SINGLE_ROW = "one row"

    def __init__(self, outline: Outline) -> None:
        self._parent: dict[str, str] = {}
        self._places: dict[str, list[Node]] = defaultdict(list)
        groups = list(outline.body.walk())
        # A class connects its members with what the query says of the class itself.
        self._described = {
            edge.subject.value
            for group in groups
            for edge in group.edges
            if edge.subject.kind == "iri"
        }
        totals = {id(inner.body) for inner in outline.inner if inner.is_total}
        for group in groups:
            self._join_edges(group)
            self._join_expressions(group)
            if id(group) in totals:
                self._join([self._SINGLE_ROW, *_mentions(group)])
        if totals:
            self._let_totals_pass()

    def parts(self) -> list[list[Node]]:
        """Return the mentions of connected variables, set by set, in the order of the text."""
        parts: dict[str, list[Node]] = defaultdict(list)
        for name, nodes in self._places.items():
            parts[self._root(name)] += nodes
        return sorted(parts.values(), key=lambda nodes: min(node.start for node in nodes))

    def _root(self, name: str) -> str:
        while self._parent.setdefault(name, name) != name:
            name = self._parent[name]
        return name

    def _join(self, names: list[str]) -> None:
        for name in names[1:]:
            self._parent[self._root(name)] = self._root(names[0])

    def _join_edges(self, group: Group) -> None:
        """Join the ends of each pattern, and what stands in one named graph."""
        inside: list[str] = []
        for edge in group.edges:
            # A thing that the query names connects its patterns; a class that it names does not,
            # or any two patterns about cups would count as connected.
            is_type = any(step.node.value == RDF_TYPE.value for step in edge.steps)
            named = [
                end
                for end in edge.ends
                if end.kind == "iri" and (not is_type or end.value in self._described)
            ]
            variables = [end.value for end in edge.variables]
            self._join([*variables, *(f"<{end.value}>" for end in named)])
            for end in edge.variables:
                self._places[end.value].append(end)
            inside += variables
        if group.graph is not None and group.graph.kind == "variable":
            self._join([group.graph.value, *inside])

    def _join_expressions(self, group: Group) -> None:
        """Join what a FILTER, BIND, VALUES, sub-select or UNION has in common."""
        for nodes in group.filters:
            self._join([node.value for node in nodes])
        for node, nodes in group.binds:
            self._join([node.value, *(branch.value for branch in nodes)])
        self._join([node.value for node, _ in group.values])
        if group.defined:
            self._join([*(node.value for node in group.defined), *_mentions(group)])
        # The branches of a UNION are alternatives, which nothing has to connect.
        branches = [child for child in group.children if child.role == "union"]
        self._join(
            [f"union {id(group)}", *(name for branch in branches for name in _mentions(branch))]
        )

    def _let_totals_pass(self) -> None:
        """Connect sub-selects of one row, such as a count, with the rest: they go with anything."""
        total = self._root(self._SINGLE_ROW)
        other = next((name for name in self._places if self._root(name) != total), None)
        if other is not None:
            self._join([other, self._SINGLE_ROW])


def _bridges(outline: Outline) -> Iterator[Finding]:
    """Yield the patterns that share no variable with the rest, so that all is combined with all."""
    first_part, *others = _Connections(outline).parts() or [[]]
    for nodes in others:
        first = min(nodes, key=lambda node: node.start)
        if first.start == first.end:  # a blank node, of which there is nothing to point at
            continue
        words = f"nothing connects ?{as_written(first.value)} with the patterns before it"
        yield Finding(
            "missing-bridge", "likely", first.start, first.end, words, _bridge(nodes, first_part)
        )


def _mentions(group: Group) -> Iterator[str]:
    """Yield the variables of the patterns of a group and of those inside it."""
    for inner in group.walk():
        for edge in inner.edges:
            yield from (node.value for node in edge.variables)


def _bridge(nodes: list[Node], others: list[Node]) -> tuple[Repair, ...]:
    """Return the renaming that connects two parts, of the two variables most alike."""
    named = [node for node in nodes if node.start < node.end]
    pairs = [
        (likeness(node.value, other.value), node, other)
        for node in named
        for other in others
        if other.start < other.end
    ]
    if not pairs:
        return ()
    score, node, other = max(pairs, key=lambda pair: (pair[0], -pair[1].start))
    if score < 0.4:
        return ()
    edits = tuple(
        Edit(mention.start, mention.end, f"?{as_written(other.value)}")
        for mention in named
        if mention.value == node.value
    )
    return (Repair(f"write ?{as_written(other.value)} for ?{as_written(node.value)}", edits),)
