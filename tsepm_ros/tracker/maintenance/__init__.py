"""Confirmed tracks, from scan to scan."""
