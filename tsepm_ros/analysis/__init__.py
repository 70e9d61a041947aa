"""Judgement and statistics of runs with known truth."""
