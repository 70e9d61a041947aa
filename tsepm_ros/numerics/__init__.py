"""Arrays and their arithmetic, independent of sonar."""
