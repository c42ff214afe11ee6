"""The addresses for programs: one table, and everything that follows from it.

:mod:`.table` has one line for each address, :mod:`.route` says what stands in a line.
"""

from __future__ import annotations

from endpoint.routes.route import Lane, Match, Right, Route
from endpoint.routes.table import ROUTES, find, serves

__all__ = ["ROUTES", "Lane", "Match", "Right", "Route", "find", "serves"]
