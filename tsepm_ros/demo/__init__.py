"""A simulated sonar and the track initiator side by side, with a picture at the end."""
