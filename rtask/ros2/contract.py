"""What the node has to know of the operations: their messages, and which calls may wait."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rtask.client.calling.rules import CallRules
from rtask.interop.ros.schema import Schema

__all__ = ["FILE", "Contract"]

FILE = Path(__file__).with_name("contract.json")
"""Made with the distribution; not in the source tree."""


@dataclass(frozen=True)
class Contract:
    """The operations of the release that the node was made from.

    Parameters
    ----------
    schema
        Services and messages of ``rtask_msgs``.
    rules
        What follows for callers.
    """

    schema: Schema
    rules: CallRules

    def as_json(self) -> dict[str, Any]:
        """Return the contract as an object of JSON."""
        return {"schema": self.schema.as_json(), "rules": self.rules.as_json()}

    @classmethod
    def read(cls, file: Path = FILE) -> Contract:
        """Return the contract that goes with the distribution."""
        data = json.loads(file.read_text("utf-8"))
        return cls(Schema.from_json(data["schema"]), CallRules.from_json(data["rules"]))
