"""The clauses of the contract."""

from __future__ import annotations

_CLAUSES = []
SUCCEEDED, CANCELED, ABORTED = 4, 5, 6
HAND = {"name": "hand", "gripper_type": "nao_hand", "max_opening": 0.09, "max_payload": 0.5}


def clause(words):
    """Register a clause of the contract; those later in the file build on the earlier ones."""

    def register(check):
        _CLAUSES.append((words, check))
        return check

    return register


def clauses_of(*modules):
    """Return the words and the check of each clause of the modules, in their order."""
    return [
        each for module in modules for each in _CLAUSES if each[1].__module__ == module.__name__
    ]
