"""What is written: attempts, objects and outcomes as triples."""
