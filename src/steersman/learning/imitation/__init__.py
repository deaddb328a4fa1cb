"""Imitation: a network that is fitted to what a controller does, without any reward."""
