"""Names of a namespace that are imported when they are first used."""

from collections.abc import Callable, Mapping
from importlib import import_module

__all__ = ["lazily"]


def lazily(
    namespace: str, values: dict[str, object], where: Mapping[str, str]
) -> tuple[dict[str, tuple[str, str]], Callable[[str], object]]:
    """Table of a namespace's public names, and the ``__getattr__`` that imports them.

    Parameters
    ----------
    namespace
        Its name, for the message about an unknown attribute.
    values
        Its ``globals()``, which keep what has been imported.
    where
        The public names of each module below ``windsysid``, separated by spaces; under ``""``, modules. A function
        that answers what a command answers has the command's name in the namespace and a verb's name in its module:
        ``modes=find_modes``.
    """
    public = {
        name: (module, original or name)
        for module, names in where.items()
        for name, _, original in (entry.partition("=") for entry in names.split())
    }

    def imported(name: str) -> object:
        if name not in public:
            raise AttributeError(f"module '{namespace}' has no attribute '{name}'")
        module, original = public[name]
        found = import_module(f"windsysid.{module or original}")
        value = values[name] = getattr(found, original) if module else found
        return value

    return public, imported
