"""A session: messages in their order in, results out."""
