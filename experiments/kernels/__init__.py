"""Compiled primitives of the baselines: legs in padded water, times of legs, Dubins paths."""
