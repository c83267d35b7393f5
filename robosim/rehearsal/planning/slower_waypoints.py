"""Waypoints passed more slowly, all by one factor, so that the path stays what it is."""

from robosim.config.rehearsal import RehearsalConfig


def slow_down(config: RehearsalConfig, factor: float) -> RehearsalConfig:
    """Return a configuration whose motion takes `factor` times as long; rests at waypoints stay as long as they are."""
    path = config.path.model_copy(update={"acceleration": config.path.acceleration / factor**2,
                                          "angular_acceleration": config.path.angular_acceleration / factor**2})
    waypoints = tuple(waypoint.model_copy(update={
        "speed": waypoint.speed / factor, "angular_speed": waypoint.angular_speed / factor,
        "acceleration": None if waypoint.acceleration is None else waypoint.acceleration / factor**2,
    }) for waypoint in config.waypoints)
    return config.model_copy(update={"path": path, "waypoints": waypoints})
