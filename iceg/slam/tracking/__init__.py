"""The front end: every scan matched against what was seen before, and what laser and odometry do wrong on the way."""
