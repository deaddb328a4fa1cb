"""The learning algorithms: one file each, with its options and how its agent is made."""
