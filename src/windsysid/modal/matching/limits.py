"""Limits of matching measured modes to a model's: each says whether it is a probability, odds, a size or a setting."""

MODEL_FREQUENCY_ERROR = 0.03
"""Size: scale of Student's t distribution of ln f of the structure about the model: 95 % are within 8 %. A model
without the roll of its tower top is 6.4 % off (docs/measured_campbell.md), and soil and added masses do as much."""

MODEL_DAMPING_ERROR = 0.7
"""Size: scale of Student's t distribution of ln ζ about the model: 95 % are within a factor of 7, since models without
wind have no aerodynamic damping."""

MIN_MODEL_DAMPING = 1e-4
"""Setting: damping ratio of a model below which it has none, and its damping is not compared; structures have more."""

ERROR_FREEDOM = 4.0
"""Size: degrees of freedom of both distributions: one model in a hundred is 14 % off."""

MODEL_SHAPE_ERROR = 0.1
"""Size: expected 1 − MAC of a mode and its model: shapes are taken for the same from a MAC of 0.9 on (Allemang, Sound
and Vibration 37(8), 2003)."""

OTHER_SHAPE_PROBABILITY = 0.05
"""Probability: that a model's mode has no such shape as the measured one, by a wrong sign or name of a channel: one
record in twenty. Without it, a near frequency and a MAC of 0 exclude each other."""

EQUAL_SHAPE_PROBABILITY = 0.2
"""Probability: that a peak that the model lacks has the shape of one of its modes at the sensors, as the second bending
mode of a tower has at its top."""

SEEN_PROBABILITY = 0.5
"""Probability: that a mode of the model is among the measured ones; sensors see some, loads drive some."""

UNLISTED_RATE = 1.0
"""Size: expected number of measured modes that the model lacks, per factor e of frequency."""

BLADE_PASSING_PROBABILITY, HARMONIC_PROBABILITY = 0.5, 0.05
"""Probabilities: that wind on a rotor makes a measured peak at a given multiple of the blade-passing frequency, and at
any other harmonic."""

MAX_HARMONIC = 12
"""Setting: highest order n of a harmonic nP."""

LOAD_ODDS = 3.0
"""Odds: of a load against a mode that the model lacks, where `oma` says "load or mode" or finds a sinusoid."""

EXCHANGED_AXES_ODDS = 0.05
"""Odds: that fore-aft and side-side sensors have each other's names, a priori; one record in twenty."""

MIN_EXCHANGED_ODDS = 10.0
"""Odds: from which on names are taken to be exchanged, strong evidence (Kass & Raftery, J. Am. Stat. Assoc. 90,
1995)."""

MAX_ODDS = 1000.0
"""Odds: largest that are shown; calibration goes no further (`python -m validation.matching`)."""

MAX_SPEED_DIFFERENCE = 0.05
"""Size: relative difference of the rotor speeds of model and record without a warning."""
