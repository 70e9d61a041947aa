"""Recordings and bags, and running a session on them."""
