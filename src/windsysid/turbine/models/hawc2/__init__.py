"""Machines from HAWC2."""
