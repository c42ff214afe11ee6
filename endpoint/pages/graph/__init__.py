"""Pages about the graph itself: queries, terms, classes, proofs."""
