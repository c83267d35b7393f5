"""Episodes: how they are played, and their film, which is drawn from a recording.

Imports: base, config, recordings, rendering, robot, mpm."""

COLOURS = ("material", "awake")
"""What the colour of a film's grains can show: their material, or also which of them are awake."""
AUTO, ORBIT, FOLLOW = FRAMING = ("auto", "orbit", "follow")
"""Cameras of a film that frame what happens: hand, tool and containers over the whole run with the arm, the same while
the camera turns about them, and hand and tool closely."""
