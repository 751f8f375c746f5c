"""Actuation: the choice of thrusters and wheels that make the wanted wrench, and the wrench that results."""
