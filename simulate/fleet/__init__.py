"""Fleets: many robots on one endpoint, each with its own process, token and named graph."""
