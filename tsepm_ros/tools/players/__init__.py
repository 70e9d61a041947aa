"""Nodes that publish what a sonar driver would."""
