"""The web endpoint: SPARQL, graph store, rosbridge for robots, pages for people."""
