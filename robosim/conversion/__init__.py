"""Results of a run in the formats of other tools.

Imports: base, config, recordings, rendering, mpm."""

FORMATS = {"mcap": "a bag of ROS 2 in MCAP", "rosbag2": "a bag of ROS 2 in SQLite", "glb": "one frame as glTF"}
"""Format -> what it is."""
