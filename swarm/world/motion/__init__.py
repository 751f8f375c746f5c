"""The reference motions of the craft, and the random pushes on them."""
