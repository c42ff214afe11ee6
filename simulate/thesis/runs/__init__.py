"""Runs of the entries: each takes a setting and returns our figures beside the thesis's."""
