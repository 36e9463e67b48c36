"""The page of a run, served to the browser on this machine, with buttons that correct the run."""
