"""What goes wrong in a run, by time or at random: `schedule` says when, `injection` does it where it happens."""
