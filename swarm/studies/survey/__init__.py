"""`swarm survey`: where the stations stand, from recordings."""
