"""Objects instead of triples: typed classes for the vocabulary, a query builder, sessions.

>>> import rtask
>>> from rtask.model import RTASK
>>> with rtask.open(":memory:") as kb, kb.session(agent="nao-1") as s:
...     s.query(RTASK.ManipulableObject).count()
0

Unlike in the rest of the code, the files of this package refer to each other in both directions: an
instance loads missing fields through its session, a session creates instances, and a field belongs
to a class on which the same attribute is a path for queries. An interface between them would hide
these relations without removing them. Nothing outside the package takes part in them: the
knowledge base below does not know about objects.
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
