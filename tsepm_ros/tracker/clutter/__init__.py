"""Clutter: density, amplitude, and what is learned of them."""
