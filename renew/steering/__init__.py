"""Turn a path into a trajectory that the vessel can steer: turning radius r', rounded corners."""
