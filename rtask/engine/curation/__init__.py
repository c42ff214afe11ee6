"""Corrections by people: merging, splitting, naming, forgetting and undoing."""
