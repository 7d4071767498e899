"""Blocks of samples from senders: their bytes, their limits, and how many may wait."""
