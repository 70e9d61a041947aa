"""Kalman filters, motion models, and tracks as arrays."""
