"""Planned tasks carried out by whole arms, which share a table in physics."""
