"""Pictures of runs and of evaluations."""
