"""The basis of designs, of a craft's photodiodes or of stations: poses, a flown scene, sight, spreads and bounds."""
