"""The method `score`: a target false-track rate that is kept."""
