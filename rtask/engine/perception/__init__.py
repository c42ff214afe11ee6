"""What a robot saw: decoded, recognised, identified, and placed in its frame."""
