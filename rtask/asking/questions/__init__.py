"""Questions in words, answered by the ontology's own questions."""

from rtask.asking.questions.answering import Answer, Near, answer

__all__ = ["Answer", "Near", "answer"]
