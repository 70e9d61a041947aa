"""Design of a sonar's parameters at a false-track rate."""
