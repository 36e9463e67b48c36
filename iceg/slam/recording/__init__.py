"""What the recorder or the odometry got wrong: repeated scans, readings that stand still, steps no robot makes."""
