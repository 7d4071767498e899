"""Mechanics, loads, biases, parameters and sensors as one state-space model, and one step of it."""
