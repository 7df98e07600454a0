"""The planners that are compared: the paper's seven baselines, stronger rivals, and ours."""
