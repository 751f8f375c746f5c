"""The choice of places for lighthouse stations."""
