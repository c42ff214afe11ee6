"""Moving pictures for documentation: robots at work, and what sharing is worth."""
