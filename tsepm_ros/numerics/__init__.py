"""Arrays and their arithmetic, without a word of sonar."""
