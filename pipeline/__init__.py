"""The staged job: a catalogue entry in, outputs out.

The one place that knows files, coordinate reference systems, the network and Dask.
"""
