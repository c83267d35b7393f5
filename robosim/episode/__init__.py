"""Episodes: how they are played, and their film, which is drawn from a recording.

Imports: base, config, recordings, rendering, robot, mpm."""

COLOURS = ("material", "awake")
"""What the colour of a film's grains can show: their material, or also which of them are awake."""
FOLLOW = "follow"
"""Camera of a film that keeps hand and tool in the picture."""
