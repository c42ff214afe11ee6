"""Checks of SPARQL queries against the ontology and the graph."""
