"""Reads the outline of a query from its tokens (SPARQL 1.1 Query Language, 19.8)."""

from __future__ import annotations

from collections.abc import Sequence

from rtask.asking.check.syntax.equalities import computes_literal, equalities
from rtask.asking.check.syntax.outline import Edge, Group, Node, Outline, Role
from rtask.asking.check.syntax.paths import REPETITIONS, Path, links_of, steps_of
from rtask.asking.check.syntax.read_as import read_as, renaming
from rtask.asking.check.syntax.term_reader import TermReader
from rtask.sparql.tokens import Token

__all__ = ["read_outline"]

_BEHIND_WHERE = ("GROUP", "HAVING", "ORDER", "LIMIT", "OFFSET", "VALUES")


def read_outline(text: str, base: str = "") -> Outline:
    """Return the outline of a query that the store's parser accepts.

    Raises
    ------
    QuerySyntaxError
        The text is no query, or of a form that is not read here.
    """
    return _Reader(text, base).query()


class _Reader(TermReader):
    """One pass over the tokens of a query."""

    def __init__(self, text: str, base: str) -> None:
        super().__init__(text, base)
        self._inner: list[Outline] = []
        self._aliases: list[tuple[Node, str, str]] = []

    # The query.

    def query(self) -> Outline:
        self._prologue()
        outline = self._select(inner=None)
        outline.iris, outline.prefixes = self.iris, self._prefixes
        outline.inner, outline.aliases = self._inner, self._aliases
        return outline

    def _prologue(self) -> None:
        while self._now.is_word("BASE", "PREFIX", "VERSION"):
            word = self._next()
            if word.is_word("PREFIX"):
                name = self._next().text.partition(":")[0]
                self._prefixes[name] = self._resolved(self._next().text[1:-1])
            elif word.is_word("BASE"):
                self._base = self._resolved(self._next().text[1:-1])
            else:
                self._next()

    def _select(self, inner: Group | None) -> Outline:
        form = self._next().text.upper()
        if form not in ("SELECT", "ASK", "CONSTRUCT", "DESCRIBE"):
            raise self._fail()
        outline = Outline(form, Group("plain", self._now.start))
        if form == "SELECT":
            self._projection(outline, inner)
        elif form == "DESCRIBE":
            outline.selects_all = True
            while not (self._now.is_word("WHERE", "FROM") or self._is("{") or self._ended()):
                token = self._next()
                if token.kind == "variable":
                    outline.mentioned.append(self._variable(token))
        elif form == "CONSTRUCT" and self._is("{"):
            self._template(outline)
        while self._now.is_word("FROM"):
            self._next()
            if self._now.is_word("NAMED"):
                self._next()
            self._next()
        if self._now.is_word("WHERE"):
            self._next()
        if self._is("{"):
            read = outline.body.compared
            outline.body = self._group("plain", outline)
            outline.body.compared += read
        self._behind_where(outline, is_inner=inner is not None)
        return outline

    def _ended(self) -> bool:
        return self._now.kind == "end"

    def _projection(self, outline: Outline, inner: Group | None) -> None:
        if self._now.is_word("DISTINCT", "REDUCED"):
            self._next()
        if self._skip("*"):
            outline.selects_all = True
            return
        while not (self._is("{") or self._now.is_word("WHERE", "FROM") or self._ended()):
            if self._is("("):
                function = renaming(self._tokens, self._at)
                begin = self._at
                variables = self._expression(outline.body)
                outline.defined.append(variables.pop())
                if inner is not None:
                    self._computed(outline.defined[-1], begin, inner)
                outline.mentioned += variables
                if function is not None:
                    self._aliases.append((variables[0], function, outline.defined[-1].value))
            else:
                outline.projected.append(self._variable(self._next()))

    def _template(self, outline: Outline) -> None:
        template = self._group("plain", outline)
        for group in template.walk():
            for edge in group.edges:
                outline.mentioned += [end for end in edge.ends if end.kind == "variable"]

    def _behind_where(self, outline: Outline, *, is_inner: bool) -> None:
        grouped: list[Node] | None = None
        target: list[Node] = outline.mentioned
        while not self._ended() and not (is_inner and self._is("}")):
            token = self._now
            if token.is_word("GROUP"):
                grouped = target = []
            elif token.is_word(*_BEHIND_WHERE):
                target = outline.mentioned
                if token.is_word("VALUES"):
                    self._next()
                    self._values(outline.body)
                    continue
            elif token.kind == "variable":
                target.append(self._variable(token))
                kind = read_as(self._tokens, self._at)
                if kind:
                    outline.body.compared.append((target[-1], kind))
                if grouped is target and self._tokens[self._at - 1].is_word("AS"):
                    outline.defined.append(target[-1])  # GROUP BY (f(?x) AS ?y)
            elif self._is("{"):  # EXISTS in HAVING
                outline.body.children.append(self._group("exists", outline))
                continue
            self._next()
        outline.grouped = grouped
        outline.mentioned += grouped or []

    # Groups.

    def _group(self, role: Role, outline: Outline) -> Group:
        group = Group(role, self._next().start)
        if self._now.is_word("SELECT"):
            self._subselect(group)
            self._skip("}")
            return group
        while not self._is("}"):
            if self._ended():
                raise self._fail()
            self._element(group, outline)
        group.end = self._next().end
        return group

    def _element(self, group: Group, outline: Outline) -> None:
        token = self._now
        if token.is_word("OPTIONAL", "MINUS"):
            self._next()
            role: Role = "optional" if token.is_word("OPTIONAL") else "minus"
            group.children.append(self._group(role, outline))
        elif token.is_word("GRAPH", "SERVICE"):
            self._next()
            if self._now.is_word("SILENT"):
                self._next()
            name = self._term()
            child = self._group("service" if token.is_word("SERVICE") else "plain", outline)
            child.graph = name if token.is_word("GRAPH") else None
            group.children.append(child)
        elif token.is_word("FILTER"):
            self._next()
            group.filters.append(self._constraint(group, outline))
        elif token.is_word("BIND"):
            self._next()
            function = renaming(self._tokens, self._at)
            begin = self._at
            variables = self._expression(group, outline)
            group.binds.append((variables.pop(), variables))
            self._computed(group.binds[-1][0], begin, group)
            if function is not None:
                self._aliases.append((variables[0], function, group.binds[-1][0].value))
        elif token.is_word("VALUES"):
            self._next()
            self._values(group)
        elif self._is("{"):
            self._union(group, outline)
        elif not self._skip("."):
            self._triples(group)

    def _union(self, group: Group, outline: Outline) -> None:
        branches = [self._group("plain", outline)]
        while self._now.is_word("UNION"):
            self._next()
            branches.append(self._group("plain", outline))
        if len(branches) > 1:
            for branch in branches:
                branch.role = "union"
        group.children += branches

    def _subselect(self, group: Group) -> None:
        inner = self._select(group)
        group.end = self._now.end
        shown = {node.value for node in (*inner.projected, *inner.defined)}
        if not inner.selects_all:
            self._fresh += 1
            for node in _variables(inner):
                if node.value not in shown:
                    node.value += f" {self._fresh}"
        group.children.append(inner.body)
        self._inner.append(inner)
        group.defined = inner.defined
        for node in inner.defined:
            group.binds.append((node, []))
        for node in inner.mentioned:
            group.filters.append([node])

    def _values(self, group: Group) -> None:
        columns: list[tuple[Node, list[Node]]] = []
        if self._skip("("):
            while not self._skip(")"):
                columns.append((self._variable(self._next()), []))
        else:
            columns.append((self._variable(self._next()), []))
        self._next()  # {
        at = 0
        while not self._skip("}"):
            if self._ended():
                raise self._fail()
            if self._skip("(") or self._skip(")"):
                continue
            if self._now.is_word("UNDEF"):
                self._next()
            else:
                columns[at % len(columns)][1].append(self._term())
            at += 1
        group.values += columns

    def _constraint(self, group: Group, outline: Outline) -> list[Node]:
        """Read a FILTER: a bracketed expression, a call, or EXISTS."""
        variables: list[Node] = []
        if self._now.is_word("NOT"):
            self._next()
        if self._now.is_word("EXISTS"):
            self._next()
            group.children.append(self._group("exists", outline))
            return variables
        begin = self._at
        if not self._is("("):
            token = self._next()
            if token.kind in ("name", "iri"):
                self.iris.append(self._iri(token))
        variables = self._expression(group, outline)
        for variable, terms in equalities(self._tokens[begin : self._at], self._named_node):
            group.equal.append((self._variable(variable), terms))
        return variables

    def _computed(self, variable: Node, begin: int, group: Group) -> None:
        """Note what ``(... AS ?x)``, read up to here, lets its variable be in a group."""
        expression = self._tokens[begin + 1 : self._at - 3]
        thing = self._named_node(expression)
        if thing is not None:
            group.equal.append((variable, [thing]))
        elif computes_literal(expression):
            group.compared.append((variable, "literal"))

    def _named_node(self, tokens: Sequence[Token]) -> Node | None:
        """Return the IRI that some tokens are; None for anything else."""
        if len(tokens) != 1 or tokens[0].kind not in ("iri", "name"):
            return None
        return self._iri(tokens[0])

    def _expression(self, group: Group, outline: Outline | None = None) -> list[Node]:
        """Read a bracketed expression; return its variables, in order."""
        variables: list[Node] = []
        depth = 0
        while not self._ended():
            token = self._now
            if token.is_word("EXISTS") and outline is not None:
                self._next()
                group.children.append(self._group("exists", outline))
                continue
            self._next()
            if token.is_mark("("):
                depth += 1
            elif token.is_mark(")"):
                depth -= 1
                if depth == 0:
                    break
            elif token.kind == "variable":
                variables.append(self._variable(token))
                kind = read_as(self._tokens, self._at - 1)
                if kind:
                    group.compared.append((variables[-1], kind))
            elif token.kind in ("name", "iri"):
                self.iris.append(self._iri(token))
        return variables

    # Triple patterns.

    def _triples(self, group: Group) -> None:
        is_node = self._is("[") or self._is("(")
        subject = self._node(group)
        if is_node and (self._is(".") or self._is("}")):
            return
        self._properties(subject, group)

    def _properties(self, subject: Node, group: Group) -> None:
        while True:
            path = self._path()
            while True:
                value = self._node(group)
                _connect(self, group, subject, path, value)
                if self._skip("{|"):
                    self._properties(self.fresh(self._now.start), group)
                    self._skip("|}")
                if not self._skip(","):
                    break
            if not self._skip(";"):
                return
            while self._skip(";"):
                pass
            if any(map(self._is, (".", "}", "]", "|}"))) or self._starts_element():
                return

    def _starts_element(self) -> bool:
        return self._is("{") or self._now.is_word(
            "OPTIONAL", "MINUS", "GRAPH", "SERVICE", "FILTER", "BIND", "VALUES"
        )

    def _node(self, group: Group) -> Node:
        """Read a term, a blank node with properties, or a list."""
        start = self._now.start
        if self._skip("<<") or self._skip("<<("):
            return self._reified(group, start)
        if self._skip("["):
            node = self.fresh(start)
            if not self._is("]"):
                self._properties(node, group)
            self._skip("]")
            return node
        if self._skip("("):
            node = self.fresh(start)
            while not self._skip(")"):
                self._node(group)
            return node
        return self._term()

    def _reified(self, group: Group, start: int) -> Node:
        """Read ``<< s p o >>``: who speaks of a statement need not state it (RDF 1.2).

        The statement stands in a group of its own, so that its terms are checked as any pattern's.
        """
        inner = Group("optional", start)
        subject = self._node(inner)
        path = self._path()
        _connect(self, inner, subject, path, self._node(inner))
        node = self.fresh(start)
        if self._skip("~") and not self._is(">>"):
            node = self._term()
        if not (self._skip(">>") or self._skip(")>>")):
            raise self._fail()
        inner.end = self._now.start
        group.children.append(inner)
        about = [end for edge in inner.edges for end in edge.variables]
        group.filters.append([node, *about])  # what is said of it connects it with its terms
        return node


def _connect(reader: _Reader, group: Group, subject: Node, path: Path, value: Node) -> None:
    """Add the edges of a path between two nodes to a group."""
    if path.kind == "sequence":
        before = subject
        for part in path.parts[:-1]:
            middle = reader.fresh(part.end)
            _connect(reader, group, before, part, middle)
            before = middle
        _connect(reader, group, before, path.parts[-1], value)
        for edge in group.edges[-len(path.parts) :]:
            edge.is_path = True
        return
    if path.kind == "inverse" and path.parts[0].kind in REPETITIONS:
        inner = path.parts[0]
        link = inner.parts[0]
        if link.kind == "link" and link.start == path.start + 1:  # ^p* is (^p)*
            turned = Path("inverse", [link], None, path.start, link.end)
            path = Path(inner.kind, [turned], None, path.start, inner.end)
    if path.kind == "inverse" and path.parts[0].kind not in ("link",):
        _connect(reader, group, value, path.parts[0], subject)
        return
    inner = path.parts[0] if path.kind in REPETITIONS else path
    edge = Edge(subject, steps_of(inner), value, min(subject.start, path.start), value.end)
    edge.is_loose = path.kind in ("loose", "optional")
    edge.is_path = inner is not path
    edge.repeats = path.kind in ("repeated", "loose")
    edge.predicate = path.node if path.kind == "variable" else None
    group.edges.append(edge)
    if not edge.steps and path.kind != "variable":
        reader.iris += links_of(path)


def _variables(outline: Outline) -> list[Node]:
    """Return every mention of a variable in a query, once each."""
    mentions = [*outline.projected, *outline.defined, *outline.mentioned]
    for group in outline.body.walk():
        mentions += [node for edge in group.edges for node in edge.variables]
        mentions += [node for nodes in group.filters for node in nodes]
        mentions += [node for node, _ in (*group.equal, *group.compared)]
        for node, nodes in (*group.binds, *group.values):
            mentions += [node, *(other for other in nodes if other.kind == "variable")]
        if group.graph is not None and group.graph.kind == "variable":
            mentions.append(group.graph)
    return list({id(node): node for node in mentions}.values())
