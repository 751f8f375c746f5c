"""Lighthouse: sweep angles to a pose, its precision and its integrity."""
