"""Bridges to other libraries: rdflib and owlready2, imported on first use."""
