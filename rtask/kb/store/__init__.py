"""The quad store: named graphs, their union, pending changes and snapshots."""
