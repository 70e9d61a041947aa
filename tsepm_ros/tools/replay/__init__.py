"""Replay of recordings and bags without ROS."""
