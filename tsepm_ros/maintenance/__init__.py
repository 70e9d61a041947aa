"""Confirmed tracks carried on: association, existence, and a downstream tracker's reports."""
