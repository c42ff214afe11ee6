"""A simulated day in a lab, and questions about what robots remember of it."""
