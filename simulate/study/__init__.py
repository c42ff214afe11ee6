"""Headless experiments: many independent trials on several processes, resumable, by seed."""
