"""The choice of photodiode positions on a craft."""
