"""The viewer in a browser: recordings, runs that go on, and planned motions.

Imports: config, errors, recordings, rehearsal, scene, mpm.
"""
