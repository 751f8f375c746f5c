"""What a craft's computer runs: its pulses in, its pose and wrench out. Never the truth, never another craft."""
