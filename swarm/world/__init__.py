"""MuJoCo's truth: the craft as rigid bodies, read from their model files, and the world in which they move."""
