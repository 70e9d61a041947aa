"""Judging, counting and drawing runs with known truth. The picture needs matplotlib."""
