"""Operational modal analysis: from a record to modes."""
