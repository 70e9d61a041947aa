"""The tables of parameters, and the settings of a session made from them."""
