"""The region of a container in which its grains are counted."""

import mpm
from robosim.config.scene import ContainerConfig
from robosim.scene.frames import container_pose
from robosim.scene.models import container_shape


def container_region(name: str, container: ContainerConfig) -> tuple[mpm.Region, mpm.Pose]:
    """Return the region around what `is_in_container` counts, in the container's frame, and the pose of that frame."""
    return container_shape(name, container).region, container_pose(container)
