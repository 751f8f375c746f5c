"""Actuation: which thrusters and wheels make the wrench that the control wants, and what comes of it."""
