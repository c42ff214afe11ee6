"""Episodes: what a robot did, saw and judged in one attempt, out of a graph and into another."""
