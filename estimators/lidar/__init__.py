"""LiDAR: the pose of a target of known shape from one scan."""
