"""Pose of the sensor: attitude, mounting, pose history, and registration of scans."""
