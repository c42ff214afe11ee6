"""Ontologies for people: descriptions of terms, HTML pages, versions, upgrades.

>>> from rtask.ontology_docs import Vocabulary, bundled
>>> vocabulary = Vocabulary(bundled())
>>> vocabulary.find("mass").unit
'unit:KiloGM'
"""

from __future__ import annotations

from rtask.ontology_docs.difference import Difference, compare
from rtask.ontology_docs.pages import write_pages
from rtask.ontology_docs.source import Module, bundled, read_source
from rtask.ontology_docs.terms import Term, Vocabulary

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
