"""Parts that an instance of a service is made of, wherever it runs."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from rtask.kb.commit.access import Access
from rtask.services.definition import Definition
from rtask.services.resources import Resource
from rtask.wire.message import Answer

__all__ = ["Carried", "Commit", "InstanceSetup", "Written"]

Written = dict[str, dict[str, bytes]]
"""Contents of files by the names of data resources and by path."""
Commit = Callable[[Written, Access], None]
"""Stores what a call wrote under its caller's rights."""


@dataclass(frozen=True)
class Carried:
    """A call that was carried out and is not stored yet.

    Parameters
    ----------
    answer
        For the caller.
    written
        Contents for its data resources.
    """

    answer: Answer
    written: Written


@dataclass(frozen=True)
class InstanceSetup:
    """Parts of an instance.

    Parameters
    ----------
    definition
        Of the service; its ``source`` tells other processes where to find the class.
    resources
        Data of the instance by the names of its data resources.
    check_every
        How many calls there are to one whose effect on the state is checked; 1 = all.
    is_outdated
        Tells whether its data resources have changed since the instance was made ready.
    """

    definition: Definition
    resources: Mapping[str, Resource]
    check_every: int
    is_outdated: Callable[[], bool] = lambda: False
