"""Judging, counting and drawing runs with known truth. The pictures need matplotlib."""
