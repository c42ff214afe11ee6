"""Rules of the user on a server, over HTTP."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from rtask.client.http import HttpClient
from rtask.kb.rules.rule import Rule

__all__ = ["RuleClient"]

_ADDRESS = "/reasoner/rules"


class RuleClient(HttpClient):
    """Reads and changes the rules of a server."""

    def rules(self) -> list[Rule]:
        """Return the rules, sorted by label."""
        return [Rule.from_dict(one) for one in self._send("GET", _ADDRESS).json()["rules"]]

    def add(self, rules: Iterable[Rule], replace: bool = False) -> dict[str, Any]:
        """Add rules as one commit.

        Returns
        -------
        dict
            ``commit``, its number; ``derived``, how many statements followed; ``changed``, whether
            any rule was new.
        """
        sent = [{"label": one.label, "text": one.text, "comment": one.comment} for one in rules]
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
