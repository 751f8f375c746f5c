"""One flight: the world moves, light is measured, every craft navigates and steers, period by period."""
