"""Settings: options, parameter tables and files."""
