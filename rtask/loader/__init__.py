"""Loading and exporting ontologies and data."""
