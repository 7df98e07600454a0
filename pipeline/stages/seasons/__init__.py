"""The seasons of a run, each a task for a thread, a process or a worker of a Dask scheduler."""
