"""Application of rules up to the fixpoint, and its upkeep under changes."""
