"""The batch pipeline around the planner: from a scenario in TOML to output files.

The only package that deals with files, coordinate reference systems, the network and Dask.
"""
