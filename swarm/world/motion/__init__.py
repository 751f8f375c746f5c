"""Where craft should be: reference motions, and what pushes those that drift."""
