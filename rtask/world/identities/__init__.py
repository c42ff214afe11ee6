"""Which thing a robot sees: looks, candidates, late reports, and doubts about identity."""
