"""A mapping file for a record without description, proposed from its content, with open questions.

Names follow from tags and words (`tags`); units from the file, else from the values: gravity in the mean of an
upright accelerometer, or in the swing of one that turns with the rotor (1P), and the range in which a quantity can be.
Where more than one unit is left, the line stays a comment, so that the record is refused until somebody decides. What
remains unknown is listed as a comment too. Nothing here is believed by a reader: the file is for its owner to correct.
"""

import contextlib
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from windsysid._types import Array
from windsysid.errors import ConfigurationError, UnknownTimeError
from windsysid.inspection.limits import MAX_GRAVITY_DEVIATION
from windsysid.inspection.plausibility import GRAVITY
from windsysid.inspection.rotor import Rotor, once_per_turn
from windsysid.inspection.tags import Meaning, meaning_of
from windsysid.output.console import render
from windsysid.output.table import Table
from windsysid.records.formats import csv, format_of, read_record
from windsysid.records.formats.access.files import named_after
from windsysid.records.formats.contents.mapping import AS_IT_IS, ChannelRule, Mapping, TimeRule, load_mapping
from windsysid.records.formats.contents.source import reading_notes
from windsysid.records.formats.openfast import known_channel
from windsysid.records.moments import has_zone
from windsysid.records.quantities import implied_unit, plausible_units
from windsysid.records.record import AS_WRITTEN, Record
from windsysid.signals.textbook import short_spectra
from windsysid.units import RPM, canonical, is_same_quantity, si_unit, to_si

__all__ = ["Guess", "MappingProposal", "propose_mapping"]

_BY_FILE, _BY_VALUES = "the file says its unit", "its unit follows from the range of its values"
_UNITS_OF_ACCELERATION = ("m/s^2", "g", "mg", "mm/s^2")
_MAX_SAMPLES = 1 << 18
"""Setting: largest number of samples of a spectrum."""
_UNTIMED = "The file gives no times: write the rate, or the column and unit of the time, into [time] below."
_TIME_TO_FILL_IN = ["", "[time]", "# ? rate = # Hz", "# ? column = ", '# ? unit = "s"']


@dataclass(frozen=True)
class Guess:
    """Proposal for one channel of a file.

    Attributes
    ----------
    written : str
        Its name in the file.
    name, unit : str or None
        Proposed; None if unknown.
    evidence, doubts : tuple of str
        What speaks for it, and what is to be checked.
    axis : str
        Letter of its axis, where nothing else gives the direction: the name is a guess.
    """

    written: str
    name: str | None
    unit: str | None
    evidence: tuple[str, ...]
    doubts: tuple[str, ...]
    axis: str = ""

    @property
    def is_said(self) -> bool:
        """True if the file gives its unit."""
        return _BY_FILE in self.evidence


@dataclass(frozen=True)
class MappingProposal:
    """A proposed mapping; `to_toml` is the file.

    Attributes
    ----------
    record : str
        Name of the record.
    guesses : tuple of Guess
    given : Mapping
        What was known before: how time and text are written.
    remarks : tuple of str
        On the whole record.
    optional : bool
        Whether the file can be read without a mapping: then all channels are written as comments.
    timed : bool
        Whether the file gives its times; if not, the mapping has a place for them.
    """

    record: str
    guesses: tuple[Guess, ...]
    given: Mapping
    remarks: tuple[str, ...]
    optional: bool = False
    timed: bool = True

    def to_toml(self) -> str:
        """The mapping file; lines that somebody must decide are comments beginning with ``# ?``."""
        lines = [f"# Proposed by windsysid for {self.record}. Check each line; what is marked with ? is in doubt."]
        lines += [f"# {text}" for text in self.remarks]
        lines += [*([] if self.optional else ["", "only_listed = true"]), *_tables(self.given)]
        lines += [] if self.timed else _TIME_TO_FILL_IN
        for guess in self.guesses:
            lines += ["", *_channel(guess, self.optional)]
        return "\n".join(lines) + "\n"

    def __str__(self) -> str:
        rows = [(one.written, one.name or "?", one.unit or "?", "; ".join(one.doubts) or "–") for one in self.guesses]
        table = Table(("in the file", "name", "unit", "in doubt"), rows, "Proposed mapping", words=(0, 3))
        return render(table, *self.remarks)


def propose_mapping(path: str | Path, mapping: str | Path | Mapping | None = None) -> MappingProposal:
    """Propose a mapping for a file.

    Parameters
    ----------
    path : str or Path
    mapping : str, Path or Mapping, optional
        What is known already: how its time and its text are written, and channels to leave out (`only_listed`).

    Raises
    ------
    RecordError, ConfigurationError
        If the file cannot be read even without the units of its channels.
    """
    given = mapping if isinstance(mapping, Mapping) else Mapping() if mapping is None else load_mapping(mapping)
    try:
        return _proposal(Path(path), given)
    except UnknownTimeError:
        if given.time != TimeRule():
            raise
    return _proposal(Path(path), given, timed=False)


def _proposal(path: Path, given: Mapping, *, timed: bool = True) -> MappingProposal:
    """The proposal; where the file gives no times, without what only times show."""
    given = _with_format(path, given) if timed else given
    whole, texts = _as_it_is(path, given if timed else replace(given, time=TimeRule(rate=1.0)))
    record = read_record(path, mapping=whole)
    if record.attributes.get("source") == "OpenFAST":
        return _of_openfast(record, given)
    known = {name: _meaning(record, name) for name in record.channels}
    rotor, remark = _rotor(record, known) if timed else (None, _UNTIMED)
    guesses = [_guess(record, name, known[name] or Meaning(None, ""), rotor, timed=timed) for name in record.channels]
    left = [*_named("Left out, because they hold text", texts), *reading_notes(record.attributes)]
    about = _about(record) if timed else [f"{record.samples} samples."]
    apart = tuple(_told_apart(guess, guesses) for guess in guesses)
    return MappingProposal(record.name, apart, given, (*about, remark, *left), timed=timed)


def _named(why: str, names: tuple[str, ...]) -> list[str]:
    """A sentence that names channels; none where there are none."""
    return [f"{why}: {', '.join(names)}."] if names else []


def _meaning(record: Record, name: str) -> Meaning | None:
    """Meaning of a name, to which an acceleration's unit adds the quantity."""
    said = record.unit(name).removeprefix(AS_WRITTEN)
    with contextlib.suppress(ConfigurationError):
        return meaning_of(name) or (meaning_of(f"{name} acceleration") if is_same_quantity(said, "m/s^2") else None)
    return meaning_of(name)


def _of_openfast(record: Record, given: Mapping) -> MappingProposal:
    """Propose names for OpenFAST's channels, all as comments, since names, units and signs are known."""
    guesses = []
    for name in record.channels:
        ours, sign = known_channel(name)
        if ours == "rotor_azimuth" or sign < 0.0:
            continue  # a mapping cannot shift an angle, and a change of sign is easily overlooked
        units, why = _units(record, name, name)
        evidence = (f"read as {ours}" if ours != name else "read under OpenFAST's name",)
        guesses.append(Guess(name, ours, units[0] if units else None, evidence, () if units else (why,)))
    remark = "OpenFAST's names, units and signs are known: uncomment only the channels to be changed."
    return MappingProposal(record.name, tuple(guesses), given, (*_about(record), remark), optional=True)


def _with_format(path: Path, given: Mapping) -> Mapping:
    """Add the format of the dates in a text file to the mapping, if only one fits."""
    if format_of(path) is not csv.FORMAT:
        return given
    with named_after(path):
        found = csv.format_of_dates(path, given)
    return given if found is None else replace(given, time=replace(given.time, format=found))


def _as_it_is(path: Path, given: Mapping) -> tuple[Mapping, tuple[str, ...]]:
    """A mapping that reads all numbers of a file as they are written, and the columns of text that it leaves out."""
    raw = ChannelRule(unit=AS_IT_IS)
    if given.only_listed:
        return replace(given, channels=dict.fromkeys(given.channels, raw)), ()
    if format_of(path) is csv.FORMAT:
        with named_after(path):
            numbers, texts = csv.columns_of_text(path, given)
        if texts and numbers:
            return replace(given, channels=dict.fromkeys(numbers, raw), only_listed=True), texts
    return replace(given, channels={"*": raw}), ()


def _about(record: Record) -> list[str]:
    remarks = [f"{record.samples} samples at {record.rate:.6g} Hz, {record.duration:.6g} s."]
    if record.start is None:
        remarks.append('The start is not known: give it as [time] start = "2021-07-07T12:00:00Z".')
    elif not has_zone(record.start):
        remarks.append(f'It begins at {record.start}, in a zone that is not given: [time] zone = "Europe/Stockholm".')
    return remarks


def _rotor(record: Record, known: dict[str, Meaning | None]) -> tuple[Rotor | None, str]:
    """Rotation of the rotor, if a channel gives it in a known unit."""
    for name, meaning in known.items():
        if meaning is None or meaning.name != "rotor_speed":
            continue
        units = _units(record, name, "rotor_speed")[0]
        values = record[name]
        ok = np.isfinite(values)
        if len(units) == 1 and ok.sum() > 10:
            speed = np.interp(record.time, record.time[ok], values[ok]) * to_si(1.0, units[0])
            rotor = Rotor(speed, name)
            return rotor, f"The rotor turns at {rotor.mean * RPM:.4g} rpm (1P {rotor.mean / (2.0 * np.pi):.4g} Hz)."
    return None, "No rotor speed is known: gravity in rotating sensors (1P) was not searched for."


def _units(record: Record, name: str, quantity: str) -> tuple[tuple[str, ...], str]:
    """Possible units of a channel, and their source; `quantity` is its name in windsysid, which implies one."""
    said = record.unit(name).removeprefix(AS_WRITTEN)
    if said not in ("unknown", ""):
        try:
            return (canonical(said),), _BY_FILE
        except ConfigurationError:
            return (), f"the file says '{said}', which windsysid does not know"
    if implied_unit(quantity) is None:
        return (), "no unit is given"
    units = plausible_units(quantity, record[name])
    return units, _BY_VALUES if units else "its values fit no unit of the quantity in its name"


def _guess(record: Record, name: str, meaning: Meaning, rotor: Rotor | None, *, timed: bool = True) -> Guess:
    evidence = [meaning.source] if meaning.source else []
    quantity = meaning.name or name
    units, why = _units(record, name, quantity)
    values = record[name]
    if not np.isfinite(values).any():
        return Guess(name, meaning.name, None, tuple(evidence), (*meaning.doubts, "it has no values"))
    evidence.append(f"{np.nanmin(values):.4g} … {np.nanmax(values):.4g}, mean {np.nanmean(values):.4g}")
    gravity, shown = _gravity(record, name, values, rotor)
    meaning = _upright(meaning, shown)
    ours, doubts = meaning.name, list(meaning.doubts)
    if gravity is not None and implied_unit(quantity) in ("m/s^2", None):
        evidence.append(shown)
        units, why, more = _with_gravity(units, why, gravity, implied_unit(quantity))
        doubts += more
    evidence += [why] if why == _BY_FILE else []
    doubts += _doubts_of_unit(units, why)
    evidence += _peak(record, values, rotor) if timed else []
    unit = units[0] if len(units) == 1 else None
    if _contradicts(ours, unit):
        doubts.append(f"the name gives a quantity that is not measured in {unit}")
    return Guess(name, ours, unit, tuple(evidence), tuple(doubts), meaning.axis)


def _upright(meaning: Meaning, gravity: str) -> Meaning:
    """Meaning of a channel, vertical where its name gives an axis only and gravity shows that it stands upright."""
    if not (meaning.axis and gravity.endswith(_UPRIGHT)):
        return meaning
    return Meaning(str(meaning.name).replace("_x_", "_y_"), meaning.source, meaning.doubts[1:])


def _doubts_of_unit(units: tuple[str, ...], why: str) -> list[str]:
    """Ambiguity of a unit among `units`, and its reason."""
    if len(units) > 1:
        return [f"in {' or '.join(units)}? Its values allow each"]
    if not units:
        return [why]
    return [f"the unit follows from the values only ({units[0]})"] if why == _BY_VALUES else []


def _with_gravity(
    units: tuple[str, ...], why: str, gravity: str, implied: str | None
) -> tuple[tuple[str, ...], str, list[str]]:
    """Units, their reason and doubts, where a channel shows gravity in the unit `gravity`."""
    if why == _BY_FILE and units[0] != gravity:
        return units, why, [f"the file says {units[0]}, gravity says {gravity}"]
    if implied == "m/s^2":
        return (gravity,), "gravity", []
    return units, why, [f"is it an accelerometer in {gravity}?"]


def _contradicts(name: str | None, unit: str | None) -> bool:
    """Test whether a name gives another quantity than a unit."""
    implied = implied_unit(name) if name else None
    return bool(implied and unit) and si_unit(str(unit)) not in (implied, {"rad": "1", "1": "rad"}.get(str(implied)))


def _gravity(record: Record, name: str, values: Array, rotor: Rotor | None) -> tuple[str | None, str]:
    """The unit in which gravity shows in a channel, and how; None where it does not."""
    mean, rms = float(np.nanmean(values)), float(np.nanstd(values))
    for unit in _UNITS_OF_ACCELERATION:
        g = GRAVITY / to_si(1.0, unit)
        if abs(abs(mean) / g - 1.0) < MAX_GRAVITY_DEVIATION and 0.0 < rms < 0.3 * g:
            return unit, f"its mean is gravity in {unit}: {_UPRIGHT}"
    if rotor is not None and rotor.turns:
        swing = once_per_turn(record, values, rotor)
        for unit in _UNITS_OF_ACCELERATION:
            g = GRAVITY / to_si(1.0, unit)
            if abs(swing / g - 1.0) < MAX_GRAVITY_DEVIATION and swing > 1.2 * rms:
                return unit, f"it swings by gravity in {unit} once per turn: it turns with the rotor"
    return None, ""


def _peak(record: Record, values: Array, rotor: Rotor | None) -> list[str]:
    """The strongest frequency of a channel, where there is one."""
    some = values[:_MAX_SAMPLES]
    ok = np.isfinite(some)
    if ok.sum() < 256 or not np.nanstd(some) > 0.0:
        return []
    filled = np.interp(np.arange(some.size), np.flatnonzero(ok), some[ok])
    size = min(filled.size, 4096)
    frequency, _, density = short_spectra(filled, record.rate, size, size // 2)
    power = density.mean(axis=1)
    k = 1 + int(np.argmax(power[1:]))
    if power[k] < 20.0 * np.median(power[1:]):
        return []
    turns = ""
    if rotor is not None and rotor.turns:
        order = frequency[k] * 2.0 * np.pi / abs(rotor.mean)
        near = round(float(order))
        turns = f", {near}P" if near >= 1 and abs(order - near) < 0.05 else ""
    return [f"vibrates most at {frequency[k]:.3g} Hz{turns}"]


_PAIR = "a guess: X fore-aft and Y side-side, as where X is downwind; exchange the names where X points to the side"


_UPRIGHT = "it stands upright"


def _told_apart(guess: Guess, guesses: list[Guess]) -> Guess:
    """A guess whose name no other has: X is fore-aft where only X and Y are alike; the others keep their own."""
    axes = sorted(one.axis for one in guesses if one.name == guess.name)
    if guess.name is None or len(axes) == 1:
        return guess
    fore_aft = guess.name.replace("_x_", "_z_")
    if axes == ["x", "y"] and all(one.name != fore_aft for one in guesses):
        return replace(guess, name=fore_aft if guess.axis == "x" else guess.name, doubts=(_PAIR, *guess.doubts[1:]))
    doubt = f"several channels look like {guess.name}: which is it?"
    return replace(guess, name=None, doubts=(*guess.doubts, doubt), axis="")


def _channel(guess: Guess, optional: bool) -> list[str]:
    lines = [f"# {_one_line('; '.join(guess.evidence))}"] if guess.evidence else []
    lines += [f"# ? {_one_line(doubt)}" for doubt in guess.doubts]
    # a channel of which neither name nor unit is known is no use: its lines wait as comments
    mark = "# " if optional or (guess.name is None and guess.unit is None) else ""
    lines.append(f"{mark}[channels.{_quoted(guess.written)}]")
    named = mark if guess.name and not guess.axis else "# ? "
    lines.append(f"{named}name = {_quoted(guess.name) if guess.name else ''}")
    lines.append(f"{mark}unit = {_quoted(guess.unit)}" if guess.unit else "# ? unit = ")
    return lines


def _one_line(text: str) -> str:
    return " ".join(text.split())


def _quoted(text: str) -> str:
    import tomli_w

    return tomli_w.dumps({"x": text}).removeprefix("x = ").strip()


def _tables(given: Mapping) -> list[str]:
    """The tables ``[time]`` and ``[csv]`` of the given mapping."""
    import tomli_w

    lines: list[str] = []
    for key, rule in (("time", given.time), ("csv", given.csv)):
        said: dict[str, Any] = {name: value for name, value in vars(rule).items() if value not in (None, ())}
        if said:
            lines += ["", f"[{key}]", *tomli_w.dumps(said).strip().splitlines()]
    return lines
