"""Tracks for chart plotters, navigation stacks and monitoring."""
