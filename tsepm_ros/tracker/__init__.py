"""The tracker: one scan in, confirmed tracks out."""
