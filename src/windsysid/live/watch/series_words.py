"""Series of the watch in words: `k_side_side` is the stiffness of the tower, side-side."""

__all__ = ["said_with_name", "series_title"]

_KINDS = {"k": "stiffness", "c": "damping", "f": "frequency"}

_WORDS = (("side_side", "side-side"), ("fore_aft", "fore-aft"))

_PARTS = {"side-side": "the tower, side-side", "fore-aft": "the tower, fore-aft", "x": "the tower, x",
          "y": "the tower, y", "roll": "the tower, roll"}  # fmt: skip
"""As modes are called (``tower x``); blades are counted."""


def series_title(name: str, kind: str = "") -> str:
    """A coefficient in words: ``k_side_side`` → stiffness, side-side."""
    quantity, rest = _quantity(name)
    if not quantity and kind in _KINDS:
        quantity = _KINDS[kind]
    return f"{quantity}, {rest}" if quantity else rest


def said_with_name(name: str) -> str:
    """A series as a sentence has it: ``k_side_side`` → stiffness of the tower, side-side (k_side_side)."""
    quantity, rest = _quantity(name)
    if not quantity:
        return name
    blade = rest.partition("beta ")[2]
    part = f"blade {blade}" if blade else _PARTS.get(rest, f"the {rest}" if quantity == "noise" else rest)
    return f"{quantity} of {part} ({name})"


def _quantity(name: str) -> tuple[str, str]:
    """Quantity and part of a series; the quantity is empty if the name does not contain it."""
    for spelled, said in _WORDS:
        name = name.replace(spelled, said)
    first, _, rest = name.partition("_")
    quantity = "noise" if first == "noise" else _KINDS.get(first, "")
    return (quantity, rest.replace("_", " ")) if quantity and rest else ("", name.replace("_", " "))
