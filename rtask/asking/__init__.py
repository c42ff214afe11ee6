"""Asking the graph: terms as people write them, checked queries, questions in words."""
