"""Episodes: how they are played, and their film, which is drawn from a recording.

Imports: base, config, recordings, rendering, robot, mpm."""

AUTO, ORBIT, NEAR = FRAMING = ("auto", "orbit", "near")
"""Cameras of a film that frame what happens: hand, tool and containers over the whole run with the arm, the same while
the camera turns about them, and the tool, which the camera follows on the side to which it empties."""
