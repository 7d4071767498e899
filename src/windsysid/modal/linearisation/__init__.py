"""Modes of a model that another program linearised."""
