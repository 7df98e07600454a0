"""The planners that are compared: the paper's baselines, rivals for least fuel, and ours."""
