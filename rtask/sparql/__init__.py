"""SPARQL texts: tokens, outline, cost and syntax, read before any store evaluates them."""
