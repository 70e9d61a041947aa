"""The sensor, its scans, and their detections in the fixed frame."""
