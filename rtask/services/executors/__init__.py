"""Where the instances of services live: threads, processes, a Ray cluster."""
