"""What this robot's odometry does wrong, as its own log tells: bias, delay, noise, standstill and jumps."""
