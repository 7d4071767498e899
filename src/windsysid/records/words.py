"""Words of the names of channels, in English: loggers write German, Spanish and French, too."""

import re
import unicodedata

__all__ = ["in_english", "words_of"]

_WORDS = {
    "aceleracion": "acceleration", "torre": "tower", "tour": "tower", "gondola": "nacelle", "buje": "hub",
    "moyeu": "hub", "pala": "blade", "pale": "blade", "velocidad": "speed", "vitesse": "speed", "viento": "wind",
    "vent": "wind", "direccion": "direction", "potencia": "power", "puissance": "power", "generador": "generator",
    "generateur": "generator", "transversal": "lateral", "guinada": "yaw", "azimut": "azimuth",
    "temperatur": "temperature", "temperatura": "temperature", "beschl": "acceleration",
}  # fmt: skip
_PARTS = {
    "beschleunigung": "acceleration", "geschwindigkeit": "speed", "drehzahl": "rpm", "richtung": "direction",
    "leistung": "power", "blattwinkel": "pitch", "blatt": "blade", "turm": "tower", "gondel": "nacelle", "nabe": "hub",
    "fundament": "foundation", "seitlich": "side", "seite": "side", "quer": "lateral", "langs": "longitudinal",
    "laengs": "longitudinal", "vorne": "fore", "vorn": "fore", "dehnung": "strain", "auslenkung": "displacement",
}  # fmt: skip
"""Parts of German compounds: Turmkopfbeschleunigung is tower kopf acceleration."""
_COMPOUND = re.compile(rf"{'|'.join(_PARTS)}", re.IGNORECASE)
_WORD = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+|\d+")


def in_english(name: str) -> str:
    """Spell a name without accents and with its German, Spanish and French words in English.

    Examples
    --------
    >>> in_english("Aceleración torre [mg]"), in_english("Turm_Querbeschleunigung")
    ('acceleration tower [mg]', ' tower _ lateral  acceleration ')
    """
    plain = unicodedata.normalize("NFKD", name).encode("ascii", "ignore").decode()
    parts = _COMPOUND.sub(lambda found: f" {_PARTS[found[0].lower()]} ", plain)
    return re.sub(r"[A-Za-z]+", lambda found: _WORDS.get(found[0].lower(), found[0]), parts)


def words_of(name: str) -> list[str]:
    """Split a name into its words, in English and small letters.

    Examples
    --------
    >>> words_of("NacAccX_2"), words_of("Windgeschwindigkeit")
    (['nac', 'acc', 'x', '2'], ['wind', 'speed'])
    """
    return [word.lower() for word in _WORD.findall(in_english(name))]
