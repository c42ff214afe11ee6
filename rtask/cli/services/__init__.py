"""Commands on algorithms that are offered as services, and on their data."""
