"""Plans for tasks of robots, from what the graph knows."""
