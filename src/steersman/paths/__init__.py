"""Paths to follow: analytic curves, packaged tracks, random roads and the user's own files."""
