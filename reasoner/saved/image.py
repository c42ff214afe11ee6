"""Image of a closure: all that it holds as arrays and plain data, written to a folder and read."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pyoxigraph
from pyoxigraph import BlankNode, NamedNode

from reasoner.facts.arrays import Column
from reasoner.facts.equality import Equality
from reasoner.facts.relations import Facts
from reasoner.fixpoint.checks import Inconsistency
from reasoner.fixpoint.maintenance import State
from reasoner.rules.schema import SchemaProblem
from reasoner.rules.strata import Program
from reasoner.rules.user_rules import LabelledRule
from reasoner.saved.container import read_folder, write_folder
from reasoner.saved.rules import (
    distinct_from_data,
    distinct_to_data,
    facts_from_data,
    rules_from_data,
    rules_to_data,
)
from reasoner.terms.dictionary import Dictionary, Term
from reasoner.terms.table import Array, TermTable


@dataclass(frozen=True)
class Contents:
    """The parts of a closure.

    Attributes
    ----------
    reifiers : set of Term
        Terms that stand for statements; what is said of them is left out.
    skipped : int
        How many triples were left out.
    """

    terms: Dictionary
    state: State
    reifiers: set[Term]
    skipped: int


@dataclass(frozen=True)
class Image:
    """A closure as arrays and JSON-able data; later changes of the closure do not affect it.

    Attributes
    ----------
    arrays : dict of str to array
        ``r_*``, ``l_*``, ``v_*`` terms (:class:`~reasoner.terms.table.TermTable`); ``a_*``
        asserted and ``f_*`` derived facts by property: ids of the properties, numbers of facts,
        keys; ``same`` terms and their representatives.
    document : dict of str to object
        Rules, contradictions, and what could not be read.
    """

    arrays: dict[str, Array]
    document: dict[str, Any]

    @classmethod
    def of(cls, contents: Contents) -> Image:
        """Make an image of a closure that nobody changes meanwhile."""
        state = contents.state
        table = contents.terms.table()
        arrays = table.arrays()
        _put_columns(arrays, "a", state.asserted.columns())
        _put_columns(arrays, "f", state.facts.columns())
        classes = list(state.equality.classes())
        pairs = [(m, representative) for representative, members in classes for m in members]
        arrays["same"] = np.array(pairs, np.uint64).reshape(-1)
        document = {
            "rules": rules_to_data(state.program.rules),
            "distinct": [distinct_to_data(each) for each in state.program.distinct],
            "problems": [[problem.node, problem.message] for problem in state.problems],
            "clashes": [
                [c.rule, [*map(list, c.premises)], [*map(list, c.because)]]
                for c in state.clashes.values()
            ],
            "variants": [list(group) for group in table.variants],
            "reifiers": sorted(map(str, contents.reifiers)),
            "skipped": contents.skipped,
        }
        return cls(arrays, document)

    def contents(self) -> Contents:
        """Return what the image was made of; large relations stay in the arrays."""
        arrays, document = self.arrays, self.document
        terms = Dictionary(TermTable.of_arrays(arrays, document["variants"]))
        equality = Equality()
        members: dict[int, list[int]] = {}
        for member, representative in arrays["same"].reshape(-1, 2).tolist():
            members.setdefault(representative, []).append(member)
        for representative, group in members.items():
            equality.adopt(representative, group)
        program = Program(
            rules_from_data(document["rules"]),
            map(distinct_from_data, document["distinct"]),
            terms,
        )
        clashes = [
            Inconsistency(rule, facts_from_data(premises), facts_from_data(because))
            for rule, premises, because in document["clashes"]
        ]
        state = State(
            Facts.of(_columns(arrays, "a")),
            Facts.of(_columns(arrays, "f")),
            equality,
            program,
            tuple(SchemaProblem(node, message) for node, message in document["problems"]),
            {clash.identity: clash for clash in clashes},
        )
        reifiers: set[Term] = {_resource(text) for text in document["reifiers"]}
        return Contents(terms, state, reifiers, document["skipped"])

    def write(self, folder: Path, head: Mapping[str, Any]) -> None:
        """Write the image with a head of the caller's; see `write_folder`."""
        write_folder(folder, self.arrays, self.document, head)

    @classmethod
    def read(cls, folder: Path, head: Mapping[str, Any]) -> Image:
        """Map an image from a folder; see `read_folder`."""
        return cls(*read_folder(folder, head))


def _put_columns(arrays: dict[str, Array], name: str, columns: Mapping[int, Column]) -> None:
    order = sorted(columns)
    keys = [columns[p].keys for p in order]
    arrays[f"{name}_p"] = np.array(order, np.uint64)
    arrays[f"{name}_n"] = np.array([*map(len, keys)], np.uint64)
    arrays[f"{name}_k"] = np.concatenate(keys) if keys else np.empty(0, np.uint64)


def _columns(arrays: Mapping[str, Array], name: str) -> dict[int, Column]:
    ends = np.cumsum(arrays[f"{name}_n"]).tolist()
    keys = arrays[f"{name}_k"].view(np.uint64)
    starts = [0, *ends][: len(ends)]
    return {
        p: Column(keys[start:end])
        for p, start, end in zip(arrays[f"{name}_p"].tolist(), starts, ends, strict=True)
    }


def _resource(text: str) -> NamedNode | BlankNode:
    return BlankNode(text[2:]) if text.startswith("_:") else NamedNode(text[1:-1])


def fingerprint(rules: Iterable[str | LabelledRule], ill_typed: str) -> dict[str, str]:
    """Return what a closure depends on besides the asserted triples.

    A closure that was saved with another fingerprint may differ from one built now.

    Parameters
    ----------
    rules : iterable of str or LabelledRule
        CONSTRUCT texts.
    ill_typed : str
        As in `reasoner.Config`.
    """
    digest = hashlib.sha256()
    for rule in rules:
        given = LabelledRule(rule) if isinstance(rule, str) else rule
        digest.update(repr((given.text, given.label)).encode())
    return {"engine": _engine(), "rules": digest.hexdigest(), "ill_typed": ill_typed}


@cache
def _engine() -> str:
    """Return a digest of the reasoner's own source and of the libraries that its results rest on.

    A number in the source would have to be raised by hand with each change.
    """
    digest = hashlib.sha256()
    root = Path(__file__).resolve().parents[1]
    for path in sorted(root.rglob("*.py")):
        digest.update(path.relative_to(root).as_posix().encode() + b"\0" + path.read_bytes())
    return f"{digest.hexdigest()[:32]} pyoxigraph {pyoxigraph.__version__}"
