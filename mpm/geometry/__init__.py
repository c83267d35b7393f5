"""Shapes of colliders as signed distances, regions that count grains, and rigid motion.

Imports: backend, cache_folder, errors, files, input_files.
"""
