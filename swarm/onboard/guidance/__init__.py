"""Where craft decide to fly: docking, formations, station keeping, by what each knows and by what others broadcast."""
