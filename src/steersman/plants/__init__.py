"""Plants: what a command moves."""
