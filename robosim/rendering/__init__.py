"""Rendering: OpenGL without a display, scenes with grains, video files, contact sheets.

Imports: base, config, mpm."""
