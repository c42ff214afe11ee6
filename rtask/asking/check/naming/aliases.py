"""Names that expressions give to variables whose own names say nothing.

Who writes ``(MIN(?w) AS ?width)`` says with the second name what the first stands for.
"""

from __future__ import annotations

from rtask.asking.check.naming.meanings import head_of, literals_by_word
from rtask.asking.check.syntax.outline import Outline
from rtask.asking.check.vocabulary import Vocabulary

__all__ = ["name_by_aliases"]


def name_by_aliases(outline: Outline, vocabulary: Vocabulary) -> None:
    """Give the variables of a query's patterns the names that its expressions give them.

    What is added up is a number, so that only the name of one counts. A count says nothing of what
    is counted: ``(COUNT(?a) AS ?times)``, ``(COUNT(?waypoint) AS ?points)``.
    """
    for node, function, alias in outline.aliases:
        word = head_of(alias)
        if head_of(node.value) or not word:
            continue
        if function not in ("", "SAMPLE") and word not in literals_by_word(vocabulary):
            continue
        for mention in outline.mentions_of(node.value):
            mention.alias = alias
