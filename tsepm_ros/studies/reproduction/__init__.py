"""Regeneration of published results, compared with the published values.

A source is a module with a function that takes a `report.ReportSetting` and returns the parts of its
chapter, and a line in `report.SOURCES`.
"""
