"""SHACL shapes: where they come from, and the statements that they examine."""
