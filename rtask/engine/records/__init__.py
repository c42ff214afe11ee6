"""Records: attempts, objects and outcomes as triples."""
