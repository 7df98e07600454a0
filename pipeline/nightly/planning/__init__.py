"""The work: charts and currents, and batches of cases for the workers."""
