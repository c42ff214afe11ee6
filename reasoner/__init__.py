"""OWL 2 RL closure, contradictions and proofs over the shared graph."""
