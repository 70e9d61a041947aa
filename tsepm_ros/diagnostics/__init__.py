"""The health of a session, judged by rules over its figures."""
