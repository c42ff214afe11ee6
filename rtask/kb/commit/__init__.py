"""Writing: transactions, rights, exact deltas, conclusions and commits."""
