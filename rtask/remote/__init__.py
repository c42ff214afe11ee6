"""A knowledge base stored on a SPARQL 1.1 server."""
