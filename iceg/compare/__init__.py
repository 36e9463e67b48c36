"""Two runs of one log side by side, scan by scan."""
