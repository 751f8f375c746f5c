"""Faults of a run, by time or at random: `schedule` determines their times, `injection` applies them."""
