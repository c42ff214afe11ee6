"""Objects instead of triples: typed classes for the vocabulary, a query builder, sessions.

>>> import rtask
>>> from rtask.model import RTASK
>>> with rtask.open(":memory:") as kb, kb.session(agent="nao-1") as s:
...     s.query(RTASK.ManipulableObject).count()
0

Read from below: :mod:`~rtask.model.instance` has the base class of objects, and what a property and
a unit of work are to them; :mod:`~rtask.model.fields` are properties that read and change values,
and on the class itself begin a path of :mod:`~rtask.model.query`; :mod:`~rtask.model.reading` turns
statements into objects, :mod:`~rtask.model.flush` objects into statements, and
:mod:`~rtask.model.session` is the unit of work. The knowledge base does not know about objects.
"""

from __future__ import annotations

from rtask.errors import FieldError, LazyLoadError, OwnershipError
from rtask.model.codec import LangString
from rtask.model.dynamic import Vocabulary, load_model
from rtask.model.generated import rtask as RTASK
from rtask.model.instance import Model
from rtask.model.query.builder import Query
from rtask.model.query.expressions import Path, avg, count, maximum, minimum, total
from rtask.model.session import Session

__all__ = [
    "RTASK",
    "FieldError",
    "LangString",
    "LazyLoadError",
    "Model",
    "OwnershipError",
    "Path",
    "Query",
    "Session",
    "Vocabulary",
    "avg",
    "count",
    "load_model",
    "maximum",
    "minimum",
    "total",
]
