"""Python of the restricted kind that controllers are written in, as C99."""
