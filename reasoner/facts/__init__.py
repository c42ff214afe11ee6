"""Sets of facts over ids: relations, arrays, layers and classes of equal terms."""
