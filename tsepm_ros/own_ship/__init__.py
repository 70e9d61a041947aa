"""Where the sensor is: attitude, mounting, poses in time, and scans put in the fixed frame."""
