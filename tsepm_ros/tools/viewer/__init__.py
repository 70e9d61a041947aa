"""The page: live, replayed and in a file."""
