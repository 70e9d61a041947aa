"""Studies of the literature: eight methods, and the reproduction of the sources."""
