"""The paper's experiments again: environments, baselines, tables, and stronger rivals."""
