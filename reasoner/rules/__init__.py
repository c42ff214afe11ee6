"""Rules: as data, compiled from a schema, and written by users."""
