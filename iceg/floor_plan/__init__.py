"""Floor plans: the walls of a run as straight lines that meet at corners."""
