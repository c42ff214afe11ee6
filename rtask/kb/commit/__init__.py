"""Writing: transactions, access rights, exact deltas, inference and commits."""
