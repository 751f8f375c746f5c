"""Two cameras: the pose of a target from the images of its lights."""
