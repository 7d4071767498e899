"""Limits of the readers of models, with their reasons."""

__all__: list[str] = []

MAX_FILE_BYTES = 1 << 26
"""Setting: largest input file [bytes]; the largest of OpenFAST's text inputs that describe a structure have 1 MB."""

MIN_GYRATION, MAX_GYRATION = 0.002, 0.2
"""Size: radius of gyration of a section, √(EI/m)/c with steel's speed of sound c, as a share of the length of the beam.
Towers and blades have 0.004 to 0.04; an error by 1000 in the unit of EI or mass is a factor of 32."""

STEEL_SOUND_SPEED = 5100.0
"""Size: √(E/ρ) of steel [m/s]; glass and carbon fibre have 4000 to 9000."""

AERODYNAMIC_DAMPING = (0.002, 0.05)
"""Size: damping ratio that air adds to a tower in operation, side-side and fore-aft [1]: 0.002 and 0.064 for the NREL
5 MW turbine in steady wind of 12 m/s (fits of decays, OpenFAST 5.0)."""

PARKED_DAMPING = (0.003, 0.005)
"""Size: damping ratio of soil, air and dampers, which models leave out, on a parked tower [1]; measured towers have
0.002 to 0.025 in all."""

DAMPING_SPREAD = 0.8
"""Size: relative standard deviation of the prior of damping, which a model knows by its author's guess only."""

STIFFNESS_SPREAD = 0.3
"""Size: relative standard deviation of the prior of stiffness: foundations of models are off by as much."""

LOAD_DEFLECTIONS = {"side_side": 0.011, "fore_aft": 0.045, "blade": 0.0013, "roll": 8e-5}
"""Size: rms of loads over stiffness [m, rad], where the estimate of the load starts: those of the NREL 5 MW turbine in
wind of 12 m/s."""

PASSING_SHARE = 0.25
"""Size: rms of the load at the blade-passing frequency as a share of the random load, where its estimate starts."""
