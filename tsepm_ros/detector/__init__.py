"""Sonar images to detections, without ROS: `SonarImage` in, `Scan` out."""
