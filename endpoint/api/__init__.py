"""Resources for clients that speak no SPARQL."""
