"""Numbers that a policy's network can read: the registered family ``feature``."""
