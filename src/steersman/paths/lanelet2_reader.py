"""Lanelet2's own library over a map, in a process of its own: it crashes on some damaged maps."""

from __future__ import annotations

import json
import sys
from typing import Any


def main() -> None:
    """Write the lanelets of a map as JSON; the arguments are file, origin and whether local."""
    file, latitude, longitude, local = sys.argv[1:5]
    found = lanelets(file, float(latitude), float(longitude), local=local == "1")
    sys.stdout.write(json.dumps(found))


def lanelets(file: str, latitude: float, longitude: float, *, local: bool) -> dict[str, Any]:
    """What is known of each lanelet, by id: its centre line, subtype, and what it leads to.

    Args:
        file: the map.
        latitude: of the origin [deg], where x and y are metres east and north of it.
        longitude: the same.
        local: whether points lie where their local_x and local_y say.
    """
    from lanelet2 import io, projection, routing, traffic_rules

    projector = projection.LocalCartesianProjector(io.Origin(latitude, longitude))
    found, _ = io.loadRobust(file, projector)
    for point in found.pointLayer if local else ():
        x, y = (float(point.attributes[name]) for name in ("local_x", "local_y"))
        point.x, point.y = x, y
    cars = traffic_rules.Participants.Vehicle
    graph = routing.RoutingGraph(found, traffic_rules.create(traffic_rules.Locations.Germany, cars))
    return {
        str(each.id): {
            "line": [(point.x, point.y) for point in each.centerline],
            "subtype": dict(each.attributes.items()).get("subtype", ""),
            "leads_to": [str(other.id) for other in graph.following(each)],
        }
        for each in found.laneletLayer
    }
