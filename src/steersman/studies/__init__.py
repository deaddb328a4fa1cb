"""Studies: what uses learning and the bench together."""
