"""Addresses to which other parts of the server lead or link; :mod:`.table` has all of them."""

from __future__ import annotations

from typing import Final

SPARQL: Final = "/sparql"
STORE: Final = "/store"
ASK: Final = "/ask"
TERMS: Final = "/terms"
ENGINE: Final = "/engine"
SERVICES: Final = "/services"
JOBS: Final = "/jobs"
DATASETS: Final = "/datasets"
MCP: Final = "/mcp"
MCP_SERVICES: Final = "/mcp/services"
REASONER: Final = "/reasoner"
RULES: Final = "/reasoner/rules"
PROPOSALS: Final = "/proposals"
API: Final = "/api"
CONTEXT: Final = "/api/context.jsonld"
BLOBS: Final = "/api/blobs"
CHANGES: Final = "/changes"
ACTIVITY: Final = "/activity/events"
RECORDS: Final = "/replicate/records"
SNAPSHOT: Final = "/replicate/snapshot"
ASKED: Final = "/replicate/asked"
QUERIES: Final = "/queries"
HEALTH: Final = "/health"
