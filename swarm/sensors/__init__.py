"""The sensors: the light, images and scans that physics delivers to a craft."""
