"""Pages about what robots are to do."""
