"""Evaluation of methods by simulated runs."""
