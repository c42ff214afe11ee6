"""Objects instead of triples: typed classes for the vocabulary, a query builder, sessions.

>>> import rtask
>>> from rtask.model import RTASK
>>> with rtask.open(":memory:") as kb, kb.session(agent="nao-1") as s:
...     s.query(RTASK.ManipulableObject).count()
0

The files of this package refer to each other in both directions, unlike those of the rest: an
instance reads its unread fields through its session, a session makes instances, and a field
belongs to a class whose attribute, when named on the class, is a path for queries. Putting an
interface between them would hide these relations without removing them. Nothing outside the
package takes part: the knowledge base below knows nothing of objects.
"""

from __future__ import annotations

from rtask.errors import FieldError, LazyLoadError, OwnershipError
from rtask.model.codec import LangString
from rtask.model.dynamic import Vocabulary, load_model
from rtask.model.expressions import avg, count, maximum, minimum, total
from rtask.model.generated import rtask as RTASK
from rtask.model.instance import Model
from rtask.model.query import Query
from rtask.model.session import Session

__all__ = [
    "RTASK",
    "FieldError",
    "LangString",
    "LazyLoadError",
    "Model",
    "OwnershipError",
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
