"""The pose filter: its equations, and two banks that run them."""
