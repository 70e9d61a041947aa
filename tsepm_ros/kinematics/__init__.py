"""States of motion: filters, models, and tracks as arrays."""
