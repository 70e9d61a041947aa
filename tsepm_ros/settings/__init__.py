"""The parameter tables, and the settings of a session made from them."""
