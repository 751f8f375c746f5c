"""Environments for learning: craft that an agent steers, over the program's own physics, light and navigation."""
