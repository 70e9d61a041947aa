"""Diagnostics: health of a session in levels and sentences."""
