"""Poses of craft relative to each other, with the errors that they share."""
