"""The graph as other libraries see it: rdflib and owlready2, neither imported before it is used."""
