"""Words printed on objects: read by an optional reader, stored with views, compared in place."""
