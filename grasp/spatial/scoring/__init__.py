"""Scores of grasp candidates, and selection among them."""
