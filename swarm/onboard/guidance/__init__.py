"""Guidance: docking, formations and station keeping, by each craft's estimate and the broadcasts of the others."""
