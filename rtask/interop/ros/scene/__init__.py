"""MoveIt's planning scene: what stands in the way, and what may be touched."""
