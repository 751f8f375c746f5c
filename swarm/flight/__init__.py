"""One flight, period by period: the world moves, light is measured, every craft navigates and steers."""
