"""OpenDRIVE: reading the lanes of a road network, and writing a path as a road."""
