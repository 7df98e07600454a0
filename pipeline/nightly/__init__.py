"""The nightly job: every case planned on the newest currents, compared, published."""
