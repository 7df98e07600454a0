"""From a path to a trajectory that the vessel can steer: r', corner rounding."""
