"""Bags of ROS 1 and ROS 2, read without ROS: which laser, which odometry, where the laser sits, and at which times."""
