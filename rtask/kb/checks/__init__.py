"""Checks of stored data: SHACL validation, quarantine and verification."""
