"""Turbines from models that other programs use, and from drawings."""
