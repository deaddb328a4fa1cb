"""A controller, a path and a vehicle for Steersman."""
