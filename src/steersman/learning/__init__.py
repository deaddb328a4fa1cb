"""Learning to steer: environments, demonstration, agents, training, export."""
