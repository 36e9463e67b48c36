"""Every beam at its own time: how a laser sweeps, learned from the log, and scans freed of the motion meanwhile."""
