"""Many robots against one endpoint: each its own process, token and graph, all learning at once."""
