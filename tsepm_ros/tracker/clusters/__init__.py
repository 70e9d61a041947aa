"""Clusters: several detections of one target in a ping."""
