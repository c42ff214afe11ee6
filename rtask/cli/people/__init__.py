"""Commands with which people ask, name and judge."""
