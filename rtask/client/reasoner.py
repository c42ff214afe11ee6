"""The reasoner of a server over HTTP: rules of the user, proofs, entailment."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from rtask.client.http import HttpClient
from rtask.kb.rules.rule import Rule
from rtask.rdf.terms import TripleKey, written

__all__ = ["ReasonerClient"]

_ADDRESS = "/reasoner/rules"
_EXPLAIN, _ENTAILS = "/reasoner/explain", "/reasoner/entails"


class ReasonerClient(HttpClient):
    """Reads and changes the rules of a server, and asks what follows from its graph and why."""

    def rules(self) -> list[Rule]:
        """Return the rules, sorted by label."""
        return [Rule.from_dict(rule) for rule in self._send("GET", _ADDRESS).json()["rules"]]

    def add(self, rules: Iterable[Rule], replace: bool = False) -> dict[str, Any]:
        """Add rules as one commit.

        Returns
        -------
        dict
            ``commit``, its number; ``derived``, how many statements followed; ``changed``, whether
            any rule was new.
        """
        sent = [{"label": rule.label, "text": rule.text, "comment": rule.comment} for rule in rules]
        body = {"rules": sent, "replace": replace}
        made: dict[str, Any] = self._send("POST", _ADDRESS, json=body).json()
        return made

    def remove(self, names: Iterable[str]) -> dict[str, Any]:
        """Remove rules, named by label or IRI, as one commit.

        Returns
        -------
        dict
            ``commit``, its number; ``withdrawn``, how many statements no longer follow.
        """
        named = {"label": list(names)}
        made: dict[str, Any] = self._send("DELETE", _ADDRESS, params=named).json()
        return made

    def explain(
        self, statement: TripleKey | tuple[str, str, str], budget: int | None = None
    ) -> dict[str, Any]:
        """Return whether a statement holds and why.

        Parameters
        ----------
        statement
            Three terms, or three texts that the server reads, so that ``kb:`` and names in quotes
            are its own.
        budget
            Steps of the reasoner; the server has a default and a limit.

        Returns
        -------
        dict
            ``holds``, None where the budget did not suffice; ``asserted_in``, the graphs that
            state it; ``proof``, and ``text``, the proof in words, both None where it does not
            hold; then ``needs``, what would make it hold, and ``reason``, in words.
        """
        texts = (part if isinstance(part, str) else written(part) for part in statement)
        named: dict[str, Any] = dict(zip("spo", texts, strict=True))
        if budget is not None:
            named["budget"] = budget
        explanation: dict[str, Any] = self._send("GET", _EXPLAIN, params=named).json()
        return explanation

    def check(self, query: str) -> list[dict[str, Any]]:
        """Return the faults of a query, as :meth:`Finding.to_dict` gives them."""
        headers = {"Content-Type": "application/sparql-query"}
        sent: dict[str, Any] = {"content": query.encode(), "headers": headers}
        answer: dict[str, Any] = self._send("POST", "/sparql/check", **sent).json()
        findings: list[dict[str, Any]] = answer.get("findings", [])
        return findings

    def entails_statement(
        self, statement: tuple[str, str, str], budget: int | None = None
    ) -> dict[str, Any]:
        """Return whether a statement in texts that the server reads follows."""
        named: dict[str, Any] = dict(zip("spo", statement, strict=True))
        if budget is not None:
            named["budget"] = budget
        entailment: dict[str, Any] = self._send("GET", _ENTAILS, params=named).json()
        return entailment

    def entails(self, triples: Iterable[TripleKey], budget: int | None = None) -> dict[str, Any]:
        """Return whether statements follow, as :meth:`Entailment.to_dict` does.

        Raises
        ------
        UsageError
            A statement cannot be tested, or there are more than a server takes at once.
        """
        lines = "".join(f"{' '.join(map(written, triple))} .\n" for triple in triples)
        headers = {"Content-Type": "application/n-triples"}
        sent: dict[str, Any] = {"content": lines.encode(), "headers": headers}
        if budget is not None:
            sent["params"] = {"budget": budget}
        entailment: dict[str, Any] = self._send("POST", _ENTAILS, **sent).json()
        return entailment
