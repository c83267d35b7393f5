"""Pictures: OpenGL without a display, the grain renderer, video files.

Imports: config, errors.
"""
