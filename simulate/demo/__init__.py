"""``rtask demo``: robots learn to grasp at a table, and share what they learned."""
