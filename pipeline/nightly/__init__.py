"""The nightly job: every case on the newest currents, compared with yesterday, published."""
