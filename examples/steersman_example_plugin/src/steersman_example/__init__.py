"""A controller, a metric, a path, a plant and a vehicle for Steersman."""
