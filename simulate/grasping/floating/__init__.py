"""Hands without an arm, to judge grasps by physics alone."""
