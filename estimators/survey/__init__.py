"""Survey: where the stations of a room stand, from the sweeps that objects of known layout saw of them."""
