"""The rotating laser scanner: so far its simulation, an analytic room and a measuring head."""

from depthwarp.scanner.head import RotatingHead
from depthwarp.scanner.room import Box, Room, furnished_room

__all__ = ["Box", "Room", "RotatingHead", "furnished_room"]
