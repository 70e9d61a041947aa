"""The track initiation methods: a module each, and a row each in `registry`."""
