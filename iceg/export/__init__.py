"""A run's results as files for other programs."""
