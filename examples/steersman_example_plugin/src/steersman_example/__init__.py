"""A controller, a metric, a path and a vehicle for Steersman."""
