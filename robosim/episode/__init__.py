"""Episodes: how they are played, and their film, which is drawn from a recording.

Imports: base, config, recordings, rendering, robot, mpm."""

AUTO, ORBIT = FRAMING = ("auto", "orbit")
"""Cameras of a film that frame what happens: hand, tool and containers over the whole run with the arm, and the same
while the camera turns about them."""
