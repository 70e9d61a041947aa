"""Own ship: attitude, poses, registration."""
