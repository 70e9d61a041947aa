"""The likelihood-ratio method."""
