"""How often the cause of an injected failure is found, and mended."""
