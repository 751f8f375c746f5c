"""Guidance of docking, formations and station keeping, from each craft's own estimate and the others' broadcasts."""
