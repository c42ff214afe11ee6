"""Ontologies for people: what terms mean, pages about them, and how two versions differ.

>>> from rtask.vocabulary import Vocabulary, bundled
>>> vocabulary = Vocabulary(bundled())
>>> vocabulary.find("mass").unit
'unit:KiloGM'
"""

from __future__ import annotations

from rtask.vocabulary.difference import Difference, compare
from rtask.vocabulary.pages import write_pages
from rtask.vocabulary.source import Module, bundled, read_source
from rtask.vocabulary.terms import Term, Vocabulary

__all__ = [
    "Difference",
    "Module",
    "Term",
    "Vocabulary",
    "bundled",
    "compare",
    "read_source",
    "write_pages",
]
