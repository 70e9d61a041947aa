"""Recordings and bags, and sessions that process them."""
