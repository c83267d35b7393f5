"""The viewer in a browser: recordings, also of runs that go on.

Imports: errors, recordings, rendering, mpm.
"""
