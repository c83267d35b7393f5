"""Configuration files: schema, loader, resources, and output that is written atomically.

Imports: base, mpm."""
