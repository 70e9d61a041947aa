"""What is learned of the surroundings: clutter, detection probability, encounters."""
