"""Drives as data to learn from: recorded while driving, out of recordings, and as Minari."""
