"""A closure on disk: arrays that are mapped into memory, and its compiled rules as data."""
