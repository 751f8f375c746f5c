"""The computer of a craft: pulses in, pose and wrench out. It never uses the truth or another craft's state."""
