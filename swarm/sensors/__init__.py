"""The sensors: which photodiodes are lit and when, camera images, and LiDAR scans, from the true motion."""
