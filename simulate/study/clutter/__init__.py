"""Piles and cluttered tables: first picks, and tables cleared."""
