"""Markers as a viewer takes them."""

from visualization_msgs.msg import Marker, MarkerArray

from support.ros_world import LATCHED


def shown_markers(world):
    """The markers from now on: those that greet a viewer have come."""
    markers = world.listen(MarkerArray, "tracks/markers", LATCHED)
    world.until(lambda: markers, "what greets a viewer")
    markers.clear()
    world.until_connected()
    return markers


def drawn(messages):
    """Ids of the tracks that a viewer of these messages shows."""
    shown = set()
    for marker in [marker for message in messages for marker in message.markers]:
        key = (marker.ns, marker.id)
        if marker.action == Marker.DELETEALL:
            shown.clear()
        elif marker.action == Marker.DELETE:
            shown.discard(key)
        else:
            shown.add(key)
    return {track_id for _, track_id in shown}
