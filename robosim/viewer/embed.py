"""A recording as a page of its own, which plays without a server and without a network."""

from robosim.recordings.reader import Recording
from robosim.viewer.history import History
from robosim.viewer.scene_view import SceneView, aim_first_camera
from robosim.viewer.server import start_server, stop_server

MOST_FRAMES = 600
"""Frames of the page: of a longer recording every second, third and so on."""


def embed_html(recording: Recording, most_frames: int = MOST_FRAMES) -> str:
    """Return an HTML document that plays a recording in 3-D: orbit with the mouse, scrub at the bottom."""
    server = start_server()
    try:
        history = History(recording)
        history.refresh()
        view = SceneView(server, recording, history)
        aim_first_camera(server, recording.header.cameras, "close")
        view.overlays.set_visible("path", True)
        stride = max(1, -(-len(recording) // most_frames))
        view.show(0)
        serializer = server.get_scene_serializer()
        for k in range(0, len(recording), stride):
            view.show(k)
            serializer.insert_sleep(stride / recording.header.frame_rate)
        return serializer.as_html()
    finally:
        stop_server(server)
