"""``rtask demo``: robots learn to grasp objects on a table, and share what they have learned."""
