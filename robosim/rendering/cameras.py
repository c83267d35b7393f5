"""Names of cameras that belong to no model."""

FOLLOW = "follow"
"""Camera of a film that keeps hand and tool in the picture."""
