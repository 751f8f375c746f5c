"""Reference motions of the craft, and the disturbances of those that drift."""
