"""The paper's experiments again: environments, baselines, tables, and rivals for least fuel."""
