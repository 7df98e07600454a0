"""Workers of a Dask scheduler: reached, watched, refused where they can't do the work."""
