"""The health of a session: rules over its figures."""
