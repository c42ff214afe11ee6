"""Commands on stored data: load, query, back up, verify."""
