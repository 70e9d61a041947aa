"""A page to watch live topics or a recording with: its frames, its server and its file."""
