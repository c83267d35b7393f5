"""Shapes of colliders as signed distances, regions that count grains, and rigid motion.

Imports: array_files, backend, errors, files."""
