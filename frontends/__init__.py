"""What feeds a graph: scans, log readers, the simulator and scan matchers."""
