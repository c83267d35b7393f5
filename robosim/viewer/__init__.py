"""The viewer in a browser: recordings, also of runs that go on.

Imports: base, recordings, rendering, reports, mpm."""
