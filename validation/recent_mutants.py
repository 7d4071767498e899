"""Deliberate faults in modules that version 0.1.0 did not have, as `validation.mutants` has them in the others."""

from validation.mutants import Mutant

__all__ = ["RECENT_MUTANTS", "RECENT_TESTS"]

RECENT_TESTS: dict[str, tuple[str, ...]] = {
    "watch/alarms.py": ("test_alarms.py", "test_watching.py"),
    "blocks/arrow.py": ("test_codec.py",),
    "azimuth.py": ("test_signals.py", "test_rotor_sources.py", "test_faulty_readings.py"),
    "cache.py": ("test_cache.py",),
    "blocks/codec.py": ("test_codec.py",),
    "records/moments.py": ("test_codec.py",),
    "checks/colour.py": ("test_colour.py",),
    "checks/dispersion.py": ("test_dispersion.py",),
    "continuity.py": ("test_continuity.py",),
    "effects/clock_drift.py": ("test_drifting_clocks.py",),
    "model/drift.py": ("test_drifting_clocks.py",),
    "spectral/drift_of_halves.py": ("test_drift_of_halves.py", "test_drifting_clocks.py"),
    "effects/random_walk_bias.py": ("test_drifting_offsets.py",),
    "events.py": ("test_events.py",),
    "follower.py": ("test_engine.py", "test_turns.py"),
    "blocks/gate.py": ("test_gate.py",),
    "estimate/prior_conflict.py": ("test_held_priors.py",),
    "modal_bands/images.py": ("test_oma.py",),
    "oma/known_modes.py": ("test_known_modes.py", "test_modes.py"),
    "levels/learning.py": ("test_jumps.py", "test_watch.py"),
    "fitted/influence.py": ("test_influence.py", "test_line_dependence.py"),
    "levels/locating.py": ("test_locating.py", "test_jumps.py", "test_watch.py"),
    "modal_bands/check.py": ("test_oma.py", "test_check.py"),
    "modal_bands/part_scores.py": ("test_part_scores.py", "test_oma.py"),
    "modal_bands/scoring.py": ("test_modal_model.py", "test_oma.py"),
    "spectral/narrow_band_alternative.py": ("test_narrow_band_beside.py",),
    "spectral/narrow_band.py": ("test_narrow_band.py", "test_narrow_bands.py"),
    "effects/bias.py": ("test_offsets.py",),
    "watch/open_alarms.py": ("test_open_alarms.py", "test_engine.py"),
    "results/estimate.py": ("test_result.py", "test_oma.py"),
    "spectral/oma/mode.py": ("test_result.py", "test_oma.py"),
    "modal/shapes.py": ("test_shapes.py", "test_oma.py"),
    "modal_bands/model_order.py": ("test_oma.py",),
    "estimate/outlier.py": ("test_outliers.py", "test_gate.py"),
    "own_information.py": ("test_comparison.py",),
    "checks/blade_passing.py": ("test_blade_passing.py",),
    "scada.py": ("test_scada.py", "test_joining.py", "test_batch.py"),
    "screening.py": ("test_screening.py",),
    "sensors.py": ("test_failing_sensors.py", "test_events.py"),
    "modal/shape_merging.py": ("test_shape_merging.py", "test_oma.py"),
    "silence.py": ("test_silence.py",),
    "sisters.py": ("test_overview.py",),
    "watch/slow_drifts.py": ("test_slow_drifts.py",),
    "stamps.py": ("test_stamps.py",),
    "checks/stationarity.py": ("test_steadiness.py",),
    "effects/sinusoid.py": ("test_steady_lines.py",),
    "checks/dead_channel.py": ("test_dead_channel.py",),
    "stops.py": ("test_stops.py",),
    "checks/nonlinearity.py": ("test_straightness.py",),
    "sentences/innovations.py": ("test_straightness.py",),
    "streams.py": ("test_streams.py",),
    "windows/timeline.py": ("test_timeline.py",),
    "levels/together.py": ("test_together.py",),
    "transforms/harmonics.py": ("test_harmonics.py", "test_oma.py", "test_steady_lines.py"),
    "within_step.py": ("test_within_step.py",),
}
"""As `validation.mutants.TESTS`."""

_READINGS = (
    Mutant(
        "readings that are smoother on the grid", "stamps.py",
        "said.sum() < MIN_LOG_LIKELIHOOD_GAIN or", "said.sum() < -MIN_LOG_LIKELIHOOD_GAIN or",
        "stamps that scatter a little are put on a grid that readings do not show",
    ),
    Mutant(
        "one channel against the grid", "stamps.py",
        "np.any(said < -MIN_LOG_LIKELIHOOD_GAIN)", "np.all(said < -MIN_LOG_LIKELIHOOD_GAIN)",
        "a grid is taken though a channel is much rougher on it",
    ),
    Mutant(
        "samples that were lost among late stamps", "stamps.py",
        "> MAX_END_STEPS:", "> 1000.0 * MAX_END_STEPS:",
        "samples of a record that lost some are numbered as if none were lost",
    ),
    Mutant(
        "spikes in the roughness", "stamps.py",
        "np.minimum(one, MAX_SQUARE_RATIO * np.nanmedian(one, axis=0))", "one",
        "one spike decides whether stamps are right",
    ),
    Mutant(
        "glitches of an azimuth", "azimuth.py",
        "np.where(glitch, near, psi) if", "psi if",
        "glitches of an azimuth stay",
    ),
    Mutant(
        "a rotor that swings", "azimuth.py",
        "if not coarse and max(lags, default=0.0) > MAX_CORRELATION * power", "if False",
        "true swings of a rotor are smoothed away",
    ),
    Mutant(
        "gaps of an azimuth", "azimuth.py",
        "np.where(known, np.mod(turned + smooth, 2.0 * np.pi), np.nan)", "np.mod(turned + smooth, 2.0 * np.pi)",
        "azimuths that are missing are made up",
    ),
    Mutant(
        "offset by chance", "effects/bias.py",
        "max(sigmas * chance, NEGLIGIBLE_SHARE * sensor.noise)", "NEGLIGIBLE_SHARE * sensor.noise",
        "sensors get offsets that are chance",
    ),
    Mutant(
        "offset and gravity", "effects/bias.py",
        "- _mean(at_rest[:, i], psi[some])", "",
        "gravity in a sensor's axis is taken for its offset",
    ),
    Mutant(
        "size of an offset", "effects/bias.py",
        'update={"bias": abs(sizes[one.channel])}', 'update={"bias": 0.01 * abs(sizes[one.channel])}',
        "an offset that was seen is not allowed for",
    ),
    Mutant(
        "drift at the slowest mode", "effects/random_walk_bias.py",
        "2.0 * math.pi * at * math.sqrt(0.5 * float(share[-1]))", "2.0 * math.pi * math.sqrt(0.5 * float(share[-1]))",
        "an offset drifts as strongly at any mode",
    ),
    Mutant(
        "loads of a flat spectrum and drift", "effects/random_walk_bias.py",
        "np.stack([np.ones_like(f), (f / below) ** 2, (f / below) ** 4])", "np.stack([(f / below) ** 4])",
        "loads that forget slowly are taken for a drift",
    ),
    Mutant(
        "mean of a trend", "effects/random_walk_bias.py",
        "readings - terms[:, 1:] @ share[1:]", "readings - terms @ share",
        "an offset goes with the trend",
    ),
    Mutant(
        "sensors that read gravity and drift", "effects/random_walk_bias.py",
        "(leaning or not sensor.feels_gravity)", "True",
        "slow leaning is taken for a drift",
    ),
    Mutant(
        "spikes that are the rule", "estimate/outlier.py",
        "if np.count_nonzero(spikes) <= MAX_MISSING_SHARE * len(values)", "if True",
        "a tenth of a channel is left out as spikes",
    ),
    Mutant(
        "outliers that are the rule", "estimate/outlier.py",
        "& (self.counts(m) <= MAX_MISSING_SHARE * samples)", "& (self.counts(m) <= samples)",
        "what a wrong model does not explain is left out",
    ),
    Mutant(
        "neighbours of a spike", "estimate/outlier.py",
        "& (beside < MAX_NEIGHBOUR_SHARE * off)", "",
        "neighbours of a spike are left out with it",
    ),
)  # fmt: skip

_CLOCKS_AND_LINES = (
    Mutant(
        "a clock faster than any", "model/drift.py",
        "< abs(self.rate) < MAX_DRIFT_RATE", "< abs(self.rate)",
        "a logger is put back by more than clocks drift",
    ),
    Mutant(
        "direction of a drifting clock", "effects/clock_drift.py",
        "off = -np.angle(amplitudes / usual) / mean", "off = np.angle(amplitudes / usual) / mean",
        "readings are put back the wrong way",
    ),
    Mutant(
        "a drift that is left", "effects/clock_drift.py",
        "one._replace(rate=before[one.logger].rate + one.rate)", "one",
        "a second look at a drift forgets the first",
    ),
    Mutant(
        "halves of a drifting record", "spectral/drift_of_halves.py",
        "(late - early) / apart", "(early - late) / apart",
        "a clock that is late later runs early",
    ),
    Mutant(
        "readings between samples", "effects/clock_drift.py",
        "np.clip(time + late, time[0], time[-1])", "np.clip(time - late, time[0], time[-1])",
        "readings of a drifting logger are moved away from when they were taken",
    ),
    Mutant(
        "scatter of a sine", "effects/sinusoid.py",
        "return bool(chance >= SCREENING_PROBABILITY and", "return bool(",
        "a load that swells and fades is taken out as a sine",
    ),
    Mutant(
        "a sine beside 1P", "effects/sinusoid.py",
        "abs(seen.frequency - rotor_hz) < HARMONIC_HALF_WIDTH_BINS * step", "False",
        "a sine at 1P is taken for a machine's",
    ),
    Mutant(
        "sines that turn", "effects/sinusoid.py",
        "return sine.order * psi", "return psi",
        "a sine at 2P goes round once in a turn",
    ),
    Mutant(
        "F of a steady sine", "transforms/harmonics.py",
        "(TAPER_COUNT - 1) * np.abs(mean) ** 2", "np.abs(mean) ** 2",
        "steady sines have a sixth of their F",
    ),
    Mutant(
        "harmonics that the steps follow", "transforms/harmonics.py",
        "0.8 * np.pi / max(step, 1e-6)", "0.01 * np.pi / max(step, 1e-6)",
        "rotor harmonics stay in the readings",
    ),
    Mutant(
        "dependence on one frequency", "fitted/influence.py",
        'return Dependence(line.channel, line.frequency, found.doubt("line_influence", line.frequency))',
        'return Dependence(line.channel, line.frequency, found.doubt("line_influence", line.ratio))',
        "a doubt names the wrong frequency",
    ),
    Mutant(
        "a line that may be chance", "fitted/influence.py",
        "if found.sigmas >= SIGMAS:", "if False:",
        "a line is called harmless though a coefficient depends on it",
    ),
    Mutant(
        "a narrow-band load next to a sinusoid", "fitted/influence.py",
        "there * (1.0 - np.maximum(over, 1.0) ** -0.5)", "there * 0.0",
        "the part of a narrow-band load next to a sinusoid is neglected",
    ),
    Mutant(
        "evidence of a narrow band", "spectral/narrow_band.py",
        "gain = ends[0].log_evidence - found.log_evidence", "gain = found.log_evidence - ends[0].log_evidence",
        "a narrow-band load is needed where it explains less",
    ),
    Mutant(
        "a narrow band that matters", "spectral/narrow_band.py",
        "self.gain > STRONG_LOG_ODDS and max(map(abs, self.moved.values())) > NEGLIGIBLE_SHIFT_SIGMAS",
        "self.gain > STRONG_LOG_ODDS",
        "loads that move no coefficient condemn a result",
    ),
    Mutant(
        "a rival that explains much worse", "spectral/narrow_band.py",
        "self.widths[name], self.chance", "self.widths[name], 0.5",
        "an explanation that is hardly possible widens as one of even chance",
    ),
    Mutant(
        "negative damping and a narrow band", "spectral/narrow_band_alternative.py",
        "return undamped or", "return",
        "a narrow band is searched next to a structure of negative damping",
    ),
    Mutant(
        "a logger whose lag was corrected", "spectral/narrow_band_alternative.py",
        "estimate=one.estimate + late.get(one.name, 0.0)", "estimate=one.estimate",
        "the lag that was corrected is missing from the result",
    ),
)  # fmt: skip

_DOUBTS = (
    Mutant(
        "a prior that holds from above", "estimate/prior_conflict.py",
        "(factor**away - 1.0)", "(factor - 1.0)",
        "a prior that holds damping up is never found",
    ),
    Mutant(
        "a likelihood that rises beyond", "estimate/prior_conflict.py",
        "> here + 0.5 * NEGLIGIBLE_SHIFT_SIGMAS**2", "> here - 0.5",
        "any prior is made wider",
    ),
    Mutant(
        "width of a wider prior", "estimate/prior_conflict.py",
        "spread=WIDENING_FACTOR * q.spread", "spread=q.spread",
        "a prior that contradicts the data is not made wider",
    ),
    Mutant(
        "a prior far from its estimate", "estimate/prior_conflict.py",
        "if abs(off) > CONFLICT_SIGMAS:", "if off > CONFLICT_SIGMAS:",
        "an estimate far below its prior is no doubt",
    ),
    Mutant(
        "the mode that moves with its parts", "checks/dispersion.py",
        "np.diag(W @ u) - W @ C @ W.T", "np.diag(W @ u)",
        "parts that differ are given too much room",
    ),
    Mutant(
        "the step to the mode", "checks/dispersion.py",
        " - F @ step @ u", "",
        "parts are judged where no mode is",
    ),
    Mutant(
        "blades that pass unsteadily", "checks/blade_passing.py",
        "or scatter > width:", "or scatter > 100.0 * width:",
        "blades that pass now here and now there are said to pass on the mode",
    ),
    Mutant(
        "turns of the passing blades", "checks/blade_passing.py",
        "_stands_out(values, blades * azimuth)", "_stands_out(values, azimuth)",
        "1P is looked for instead of the passing blades",
    ),
    Mutant(
        "blade passing near a mode", "checks/blade_passing.py",
        "> width + HARMONIC_HALF_WIDTH_BINS * step", "> 10.0 * width + HARMONIC_HALF_WIDTH_BINS * step",
        "blades that pass far from a mode are said to pass on it",
    ),
    Mutant(
        "tails of normal innovations", "checks/stationarity.py",
        "3.0 * window / (window + 2.0)", "3.0",
        "short windows have light tails",
    ),
    Mutant(
        "unsteadiness beyond chance", "checks/stationarity.py",
        "math.sqrt(max(variance - by_chance, 0.0))", "math.sqrt(max(variance, 0.0))",
        "steady loads are said to swell",
    ),
    Mutant(
        "blades that are late", "checks/stationarity.py",
        "-np.sin(azimuth + angle) * z[:, tower[0]]", "np.sin(azimuth + angle) * z[:, tower[0]]",
        "late blades are looked for against the way they turn",
    ),
    Mutant(
        "which of two channels is late", "checks/stationarity.py",
        "int(lag) - MAX_LAG, correlation", "MAX_LAG - int(lag), correlation",
        "the channel that is early is said to be late",
    ),
    Mutant(
        "neighbours under Hann's window", "checks/dead_channel.py",
        "2.0 * _shape(width), 2.0 * _shape(n - width)", "2.0 * width, 2.0 * (n - width)",
        "noise is said to vibrate",
    ),
    Mutant(
        "gravity in a dead channel", "checks/dead_channel.py",
        "may_be_no_line(f, (), rotor_hz, ", "may_be_no_line(f, (), 0.0, ",
        "gravity on a blade passes for vibration",
    ),
    Mutant(
        "noise of a power law", "checks/dead_channel.py",
        "power / f**slope", "power",
        "drifting noise is said to vibrate",
    ),
    Mutant(
        "what a straight line explains", "checks/nonlinearity.py",
        "cubes - basis @ (basis.T @ cubes)", "cubes",
        "a straight spring is said to be bent",
    ),
    Mutant(
        "number of looks at cubes", "checks/nonlinearity.py",
        "chance / tested", "min(1.0, chance * tested)",
        "many channels find a bend by chance",
    ),
    Mutant(
        "friction or a damper", "sentences/innovations.py",
        '(d["sigmas"] > 0.0) is (d["law"] == "stiffness")', 'd["sigmas"] > 0.0',
        "damping that falls with amplitude is said to grow",
    ),
    Mutant(
        "one level all over", "checks/colour.py",
        "self.slope / self.slope_bound, self.size", "self.size",
        "loads that are louder than thought condemn a result",
    ),
    Mutant(
        "size beyond chance", "checks/colour.py",
        "np.square(s - 1.0) - 2.0)", "np.square(s - 1.0))",
        "short records have a large departure from white",
    ),
    Mutant(
        "alike neighbours of a spectrum", "checks/colour.py",
        "float(seen.sum()) / alike", "float(seen.sum())",
        "white innovations are called coloured",
    ),
    Mutant(
        "loads that go on within a step", "within_step.py",
        "(turned - 1.0) / (turned + 1.0)", "(turned + 1.0) / (turned + 1.0)",
        "a load that forgets within steps has more power than it has",
    ),
    Mutant(
        "variance within a step", "within_step.py",
        "rates * step / 12.0", "rates * step / 3.0",
        "loads within a step have twice their size",
    ),
    Mutant(
        "loads that run smoothly", "within_step.py",
        "(np.abs(rows @ axes).max(axis=0) > 0.0)", "(np.abs(rows @ axes).max(axis=0) >= 0.0)",
        "a load that runs smoothly is made rough",
    ),
)  # fmt: skip

_LIVE = (
    Mutant(
        "texts without end", "blocks/arrow.py",
        "if length > MAX_TEXT_BYTES or begin + length > len(payload):", "if begin + length > len(payload):",
        "a name of megabytes is taken in",
    ),
    Mutant(
        "texts beyond the payload", "blocks/arrow.py",
        "if length > MAX_TEXT_BYTES or begin + length > len(payload):", "if length > MAX_TEXT_BYTES:",
        "a text that leads out of the payload is cut in silence",
    ),
    Mutant(
        "batches without end", "blocks/arrow.py",
        "if len(batches) > MAX_BATCHES:", "if len(batches) > 1000 * MAX_BATCHES:",
        "a block of a million empty batches is taken in",
    ),
    Mutant(
        "values that are null", "blocks/arrow.py",
        "[:rows] == 0, i] = np.nan", "[:rows] == 1, i] = np.nan",
        "readings that are there are missing, and the other way round",
    ),
    Mutant(
        "a column that is cut", "blocks/arrow.py",
        "or length < size or", "or",
        "a column that is cut goes on in the next one",
    ),
    Mutant(
        "schemas that are alike but for units", "blocks/arrow.py",
        "if all(payload[begin:end] == piece for begin, end, piece in known.pieces):", "if known:",
        "a logger that changes its channels keeps the names it had",
    ),
    Mutant(
        "a sequence that is no whole number", "blocks/codec.py",
        "isinstance(sequence, bool | float)", "isinstance(sequence, bool)",
        "block 7.9 is block 7",
    ),
    Mutant(
        "units of a stream", "blocks/codec.py",
        "values.astype(np.float64) * scale", "values.astype(np.float64) / scale",
        "g of a stream are a hundredth of m/s²",
    ),
    Mutant(
        "fraction of a second", "records/moments.py",
        'int(fraction[1].ljust(9, "0"))', "int(fraction[1])",
        "a block that starts at half a second starts at 5 ns",
    ),
    Mutant(
        "channels in unlike lengths", "blocks/codec.py",
        "if len(lengths) > 1:", "if len(lengths) > 2:",
        "channels of unlike lengths end in an error of NumPy",
    ),
    Mutant(
        "samples that came in part", "windows/timeline.py",
        "np.isnan(values[at : at + n]).all(axis=1)", "np.isnan(values[at : at + n]).any(axis=1)",
        "samples that came again count as new",
    ),
    Mutant(
        "samples that come again", "windows/timeline.py",
        "np.where(np.isnan(old), block.values, old)", "block.values",
        "what comes again replaces what is there",
    ),
    Mutant(
        "a stamp on the boundary", "windows/timeline.py",
        "math.ceil((until - block.start) / step - MAX_EDGE_SAMPLES)",
        "math.ceil((until - block.start) / step + MAX_EDGE_SAMPLES)",
        "the first sample of a window is in the one before, too",
    ),
    Mutant(
        "a clock that was set back", "windows/timeline.py",
        "if set_back and not", "if False and not",
        "blocks of a clock that was set back lie upon others",
    ),
    Mutant(
        "a slower logger", "windows/timeline.py",
        "np.floor(moments * lead.rate + 0.5)", "np.floor(moments * lead.rate)",
        "samples of a slower logger are half a sample early",
    ),
    Mutant(
        "a block that did not get to the store", "follower.py",
        "discard(placed.sequence)", "discard(-1)",
        "a block that was not kept cannot come again",
    ),
    Mutant(
        "numbers after one that was not kept", "follower.py",
        "min(stream.committed, placed.sequence - 1)", "stream.committed",
        "a block that was not kept is said to be",
    ),
    Mutant(
        "numbers of a window that closed", "follower.py",
        "max(stream.committed or 0, max(numbers))", "stream.committed or 0",
        "blocks of a closed window are called late when they come again",
    ),
    Mutant(
        "a stamp far ahead", "follower.py",
        "elif stream.ahead is None:\n            stream.ahead = end",
        "elif stream.ahead is None:\n            stream.newest = end",
        "one wrong stamp closes all windows",
    ),
    Mutant(
        "room for the store", "blocks/gate.py",
        "self.inside < self._most and self._bytes < self._most_bytes", "self.inside < self._most",
        "blocks on their way to the store fill memory",
    ),
    Mutant(
        "end of a drift and of a fault", "watch/open_alarms.py",
        "f\"{'drift' if state == 'drift' else 'sensor'}:{channel}\"", 'f"sensor:{channel}"',
        "a spike ends the alarm of a drift",
    ),
    Mutant(
        "a stream that is quiet", "watch/open_alarms.py",
        "if now - self._heard.get(cause, 0) > QUIET_NS]", "if now - self._heard.get(cause, 0) > 0]",
        "an alarm of late blocks ends at once",
    ),
    Mutant(
        "a dead channel of a slow logger", "streams.py",
        "max(MIN_DEAD_SECONDS, MIN_DEAD_INTERVALS * interval)", "MIN_DEAD_SECONDS",
        "a channel of one sample in a minute is dead",
    ),
    Mutant(
        "spikes that come straight back", "streams.py",
        "< 0.4 * height:", "< 4.0 * height:",
        "steps of a channel are spikes",
    ),
    Mutant(
        "windows in a row that drift", "streams.py",
        '"drift" if outside == MIN_DRIFT_WINDOWS', '"drift" if outside == 1',
        "one odd window is a drift",
    ),
    Mutant(
        "end of a fault", "streams.py",
        "self.good < RECOVERY_SECONDS:", "self.good < 0.0:",
        "a loose plug is good and bad in turns",
    ),
    Mutant(
        "an alarm of stiffness", "watch/alarms.py",
        'cause == "structure" and percent[2] <= -MIN_ALARM_LOSS_PERCENT', 'percent[2] <= -MIN_ALARM_LOSS_PERCENT',
        "a sensor that failed raises the alarm of the structure",
    ),
    Mutant(
        "a level that came back", "watch/alarms.py",
        "abs(level - jump.before) + SIGMAS * std <= MAX_REST_SHARE",
        "abs(level - jump.before) <= MAX_REST_SHARE",
        "an uncertain level is reported as normal again",
    ),
    Mutant(
        "a jump that takes back another", "watch/alarms.py",
        "return earlier.found < jump.found and", "return",
        "a loss is said to take back a rise that came after it",
    ),
    Mutant(
        "wander of a slow drift", "watch/slow_drifts.py",
        "/ math.hypot(std, wander)", "/ std",
        "what wanders by itself is an alarm",
    ),
    Mutant(
        "a drift that grew", "watch/slow_drifts.py",
        "abs(jump.size) - SIGMAS * jump.std >= MIN_GROWTH_FACTOR", "abs(jump.size) >= MIN_GROWTH_FACTOR",
        "a drift is reported again because of its scatter",
    ),
)  # fmt: skip

_FLEET_AND_MODES = (
    Mutant(
        "jumps of sisters", "events.py",
        "max(MIN_SHARED_TURBINES, 0.5 * turbines)", "max(2, 0.5 * turbines)",
        "two turbines that jump in a week are the site's",
    ),
    Mutant(
        "jumps of one coefficient in two directions", "events.py",
        "same = one.name == another.name and one.percent * another.percent > 0.0", "same = one.name == another.name",
        "a rise and a fall of like turbines are one event",
    ),
    Mutant(
        "ice in warm weather", "events.py",
        "if mean > MAX_ICING_CELSIUS or levels[top] > 0.0:", "if levels[top] > 0.0:",
        "what falls and comes back in summer is ice",
    ),
    Mutant(
        "a fall that came back", "events.py",
        "abs(levels[back]) <= MAX_REST_SHARE * np.max(np.abs(levels[: back + 1]))", "back > 0",
        "a loss that grew is said to have come back",
    ),
    Mutant(
        "variance of the others", "sisters.py",
        "(1.0 + 1.0 / (n - 1))", "(1.0 - 1.0 / (n - 1))",
        "outliers among like turbines are more often chance",
    ),
    Mutant(
        "a turbine that knows itself badly", "sisters.py",
        "max(0.0, sigma[i] ** 2 - float(np.square(sigma[others]).mean()))", "0.0",
        "a turbine with a wide band is called an outlier",
    ),
    Mutant(
        "weeks in which a sensor fails", "sensors.py",
        "if runs and number[i] - number[runs[-1][1]] <= 2:", "if runs:",
        "a sensor that failed twice in a year failed all year",
    ),
    Mutant(
        "records of a week", "sensors.py",
        "& (mine.records >= MIN_WEEKLY_RECORDS)", "",
        "one record condemns a sensor for a week",
    ),
    Mutant(
        "yaw of SCADA across north", "scada.py",
        'if name == "yaw":', 'if name == "pitch":',
        "a nacelle that looks north looks south on the mean",
    ),
    Mutant(
        "lines of SCADA that overlap in part", "scada.py",
        "float(weight @ values / weight.sum())", "float(values.mean())",
        "a line that hardly overlaps counts as much as others",
    ),
    Mutant(
        "SCADA of a part of a record", "scada.py",
        "< MIN_COVERED_SHARE * seconds", "< 0.0 * seconds",
        "SCADA of a minute speaks for ten",
    ),
    Mutant(
        "rows that are copied", "continuity.py",
        "np.add.at(mask, again + MIN_COPIED_ROWS, -1)", "np.add.at(mask, again + 1, -1)",
        "of a copied passage only its beginning is seen",
    ),
    Mutant(
        "copies of a channel upside down", "continuity.py",
        "1.0 - alike[i, j] ** 2 < MAX_COPY_RESIDUAL", "1.0 - alike[i, j] < MAX_COPY_RESIDUAL",
        "a channel of the other sign is no copy",
    ),
    Mutant(
        "breaks at odd places", "continuity.py",
        "min([(FALSE_ALARM_PROBABILITY / samples, 0)", "min([(1.0, 0)",
        "blows are said to be lost samples",
    ),
    Mutant(
        "a converter that ran over", "continuity.py",
        "MIN_OVERRUN_JUMPS or between < 0.2 or", "MIN_OVERRUN_JUMPS or",
        "a switch between two values is an overrun",
    ),
    Mutant(
        "a silent channel of a silent machine", "silence.py",
        "if any(_goes_on(record[other], run) for other in others)]", "]",
        "a machine that stands still has silent channels",
    ),
    Mutant(
        "vibration that fades", "silence.py",
        "(runs[:, 0] > 1) & (runs[:, 1] < count - 1)", "(runs[:, 0] > 1)",
        "a decay is a silent channel",
    ),
    Mutant(
        "a fall that takes minutes", "stops.py",
        "time[entry] - time[runs[before]] > MAX_FALL_SECONDS", "False",
        "a rotor that coasts to rest stops at once",
    ),
    Mutant(
        "where a section after a stop ends", "stops.py",
        "min(end, float(time[entry]) + MAX_STOP_SECONDS)", "float(time[entry]) + MAX_STOP_SECONDS",
        "a section after a stop goes on when the rotor turns again",
    ),
    Mutant(
        "decay after a stop", "stops.py",
        "section.time > section.time[0] + 0.5 * section.duration", "section.time > section.time[0]",
        "a vibration that dies away is said to stay",
    ),
    Mutant(
        "an offset that is allowed for", "screening.py",
        "> CONFLICT_SIGMAS * offset", "> 0.0 * offset",
        "a sensor whose offset is known is refused",
    ),
    Mutant(
        "prior of a mode's damping", "oma/known_modes.py",
        "- centre * spread**-2.0) / information", "+ centre * spread**-2.0) / information",
        "damping of a record is moved away from its prior twice",
    ),
    Mutant(
        "a prior that is taken out", "own_information.py",
        "(1.0 / share - 1.0) / factor)) @ rows", "(1.0 / share) / factor)) @ rows",
        "priors count twice in a comparison",
    ),
    Mutant(
        "band of a mode's damping", "results/estimate.py",
        "cls(estimate, estimate / factor, estimate * factor,", "cls(estimate, estimate - factor, estimate + factor,",
        "bands of damping ratios have the width of factors",
    ),
    Mutant(
        "reason against one quantity", "spectral/oma/mode.py",
        'reason.of in ("mode", name)', 'reason.of == "mode"',
        "a reason against a damping ratio leaves its grade",
    ),
    Mutant(
        "complexity of a shape", "modal/shapes.py",
        "np.exp(-0.5j * np.angle(np.sum(shape**2)))", "1.0",
        "a real shape that is turned as a whole is called complex",
    ),
    Mutant(
        "segments of a mode", "modal_bands/part_scores.py",
        "if seen is not None and factor > found.factor:", "if False:",
        "the interval of a frequency that varies during the record is not wider",
    ),
    Mutant(
        "an envelope of a machine", "modal_bands/check.py",
        "np.log(size.std() / size.mean())", "np.log(size.std() / size.std())",
        "a machine of constant amplitude is a mode",
    ),
    Mutant(
        "a mode at the border", "modal_bands/check.py",
        "doubts.append(Doubt(\"border\", \"it is at the edge of its frequency range\"))", "pass",
        "a mode at the border of its band is trusted",
    ),
    Mutant(
        "overlap of bins in a mode's posterior", "modal_bands/scoring.py",
        "found.gradient / band.factor, found.fisher / band.factor", "found.gradient, found.fisher",
        "bands of modes are too narrow by what bins share",
    ),
    Mutant(
        "modes of several records", "modal_bands/scoring.py",
        "shared += found.fisher[: 2 * r, : 2 * r] - across @ inner @ across.T",
        "shared += found.fisher[: 2 * r, : 2 * r]",
        "modes that records have in common are known better than they are",
    ),
    Mutant(
        "a mode more", "modal_bands/model_order.py",
        "if now < least - 2.0 * STRONG_LOG_ODDS and", "if now < least + 100.0 * STRONG_LOG_ODDS and",
        "noise has modes",
    ),
    Mutant(
        "scale of a merged shape", "modal/shape_merging.py",
        "slope[:, one.place[largest]] = -expected / base", "slope[:, one.place[largest]] = expected / base",
        "records of one shape with other sensors do not fit together",
    ),
    Mutant(
        "images of the stronger mode", "modal_bands/images.py",
        "and one.power > other.power and", "and one.power < other.power and",
        "the mode is the image of its image",
    ),
    Mutant(
        "a wander that is averaged", "levels/together.py",
        "weight * (std**2 + (level - mean) ** 2)", "weight * std**2",
        "a level is known better than its wander",
    ),
    Mutant(
        "a scatter that was learned from few", "levels/together.py",
        "jumped = blocks * np.log1p(jumped / blocks)", "pass",
        "a scatter learned from few blocks finds jumps by chance",
    ),
    Mutant(
        "growth of a variance", "levels/learning.py",
        "lowest = -2.0 if logarithmic else 0.0", "lowest = 0.0",
        "bands of a logarithmic damping grow the wrong way",
    ),
    Mutant(
        "date of a jump", "levels/locating.py",
        ">= place)[:, None]", "> place)[:, None]",
        "a jump is dated a block early",
    ),
    Mutant(
        "a cache that was damaged", "cache.py",
        "return payload if hashlib.sha256(payload).digest() == digest else None", "return payload",
        "a damaged file of the cache is used",
    ),
)  # fmt: skip

RECENT_MUTANTS: tuple[Mutant, ...] = (*_READINGS, *_CLOCKS_AND_LINES, *_DOUBTS, *_LIVE, *_FLEET_AND_MODES)
"""All of them, by subject."""
