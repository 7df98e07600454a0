"""The command line `renew`: commands, progress, summary."""
