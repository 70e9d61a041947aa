"""Models of the surroundings: clutter, detection probability, encounters."""
