"""The ground storey: SE(2), relative poses and the pose graph; knows nothing of lasers."""
