"""What physics delivers to a craft: which photodiode is lit, and when."""
