"""Measured records: named channels with units over time, and the checks on them."""
