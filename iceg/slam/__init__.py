"""The SLAM system: front end, back end, loop closing and finish."""
