"""Limits of the inspection of a record: each says whether it is a probability, odds or a size, and where it comes from.

Where a docstring names no source, the limit was set on simulated records.
"""

MIN_SAMPLES = 20
"""Size: number of samples for identification (`windsysid.identification.condition.readings`), or of frequency bins that
equations are fitted to."""

MIN_MODAL_SAMPLES = 256
"""Size: number of samples for operational modal analysis (`windsysid.spectral.oma.samples`)."""

MIN_ROTOR_SPEED = 0.05
"""Size: rotor speed of a running machine [rad/s]."""

MAX_MOTION_RMS = 4.0
"""Size: root mean square [m] of the motion that an acceleration means; the tops of the tallest turbines move by 1 m,
floaters by more only below 0.1 Hz, which is left out."""

MAX_ROTOR_SPEED = 10.0
"""Size: rotor speed [rad/s] beyond which a speed is that of a small rotor or of a generator behind a gear."""

MAX_SHORT_GAP_SAMPLES = 10
"""Size: number of lost samples of a short gap, which `windsysid.spectral.oma.samples` fills by interpolation."""

MAX_SEPARATE_GAPS = 20
"""Size: number of short gaps between which a section can be chosen."""

MAX_OFF_GRID_STEPS = 0.25
"""Size: 90th percentile of the distance of steps from whole multiples of the usual step, in usual steps, for a regular
clock that lost samples; for uniformly distributed steps it is 0.45."""

MIN_SPIKE_SIGMAS = 8.0
"""Size in standard deviations: jump of a spike over the steps around it."""

MAX_SPIKE_SAMPLES = 5
"""Size: number of samples of a spike."""

MIN_CODE_RMS = 30.0
"""Size: distance from the median, over the channel's robust rms, of a repeated value that is no reading."""

MAX_STRAIGHT_BEND_RATIO = 0.02
"""Size: second difference over its rms below which three samples are on a straight line."""

MIN_COPIED_ROWS = 32
"""Size: number of consecutive rows that equal others, in every channel that vibrates, of a copied passage."""

MIN_PREDICTED_ROWS = 1000
"""Size: number of rows for fitting a linear prediction, which detects lost rows and samples."""

MIN_OVERRUN_JUMPS = 3
"""Size: number of jumps across a channel's range from which on its converter overran."""

MAX_OVERRUN_STEP_STD = 0.17
"""Size: standard deviation of a channel's other steps over its range, beyond which a jump across it is usual."""

MAX_UNWRAPPED_RATIO = 0.06
"""Size: squared difference of an unwrapped jump from the steps next to it over that of the jump itself; spikes have at
least 0.1."""

MIN_LOSS_GAIN = 0.4
"""Size: g after a loss: 1 for one lost row, less because the losses bias the model; and ratio of the smallest to the
largest sum after two or three losses: with less, only every second or third is a loss, and k is larger."""

MAX_OTHER_GAIN_RATIO = 0.6
"""Size: |g| at any other remainder, relative to g after a loss. A sinusoid at a multiple of the rate over 2k
gives a g that alternates."""

MAX_SILENT_RMS_RATIO = 1.0 / 8.0
"""Size: rms of a channel over a period, relative to its usual one, below which it is silent; other channels are
not."""

MIN_SILENT_PERIODS = 5
"""Size: number of consecutive silent periods."""

MIN_ACCELERATION_RATE = 0.5
"""Size: sampling rate of an acceleration [Hz] below which it shows no structure."""

MAX_ACCELERATION_RATE = 20_000.0
"""Size: sampling rate of an acceleration [Hz] beyond which the time may be in another unit; few loggers are as fast."""

MAX_GRAVITY_DEVIATION = 0.03
"""Size: relative distance from g of the mean of an upright accelerometer, or of its amplitude on a rotor."""

MAX_LENGTH_PENALTY = 0.6
"""Size: penalty of a longer section above that of the median short one: equal to 3 % of the rotor speed, or 12 % of the
wind speed, since turbulence varies more over a longer time."""

MAX_SPEED_VARIATION = 0.05
"""Size: variation and drift of the rotor speed over a section, relative to its mean, of penalty 1."""

MAX_WIND_VARIATION = 0.20
"""Size: variation and drift of the wind speed over a section, relative to its mean, of penalty 1; and circular standard
deviation of the wind direction [rad], which is the variation across the wind."""

MAX_FAULT_SHARE = 0.02
"""Size: share of faulty or missing samples of a section, of penalty 1; and of missing samples, or of spikes, that
straight lines bridge for spectra. If more are missing, `oma` takes the longest segment without gaps."""

MIN_VIBRATION_FACTOR = 0.25
"""Size: rms of vibration over the record's median that is enough for identification."""

MIN_MODE_CYCLES = 40.0
"""Size: cycles of a mode in a record, or in a section of one, which `oma` needs for its damping."""

MIN_DEGREES_OF_FREEDOM = 3.0
"""Size: equivalent degrees of freedom of the power of a section, and within the narrowest resonance of a record in
segments where nothing turns: with independent bins, intervals of a tower are up to 18 times too narrow at one."""

MAX_VIBRATION_CHANGE = 2.0
"""Size: ratio of the rms values of two segments of a section, or of the halves of a record for spectra, that is
accepted even if it is significant; and from which on the vibration after a stop is a decay."""

MAX_ENERGY_SHARE = 0.6
"""Size: share of the vibration in an eighth of a section, or of a record for `oma`, beyond which it is a transient."""

MAX_REFERENCE_DISTANCE = 0.1
"""Size: relative distance in frequency up to which a peak or a mode may be one of the turbine file, whose values are
references, and up to which modes of two records may be the same."""

MAX_RATE_MISMATCH = 0.01
"""Size: relative difference up to which two values are the same:

- sampling rates of two segments (rounded time stamps make less);
- the rotor's speed as a channel and as the slope of the azimuth;
- frequencies of a peak and of a rotor harmonic."""

MAX_FALL_SECONDS = 60.0
"""Size: time from running to stopped [s]."""
