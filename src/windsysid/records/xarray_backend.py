"""windsysid's formats as an engine of xarray: ``xarray.open_dataset("mast.tdms", engine="windsysid")``.

xarray finds the engine by the entry point that windsysid's package declares. The dataset is `Record.to_xarray` of the
record that `read_record` reads: variables (time,) with ``units``, time in seconds, the start as an attribute.
"""

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import xarray as xr
from xarray.backends import BackendEntrypoint

from windsysid.records.formats import FORMATS, read_record

__all__ = ["WindsysidBackend"]

_OTHERS = (".nc", ".nc4", ".netcdf", ".h5", ".hdf5", ".hdf", ".he5")
"""Endings of files that other engines read: this one reads them where it is named."""


class WindsysidBackend(BackendEntrypoint):
    """The engine ``windsysid``."""

    description = "Records of loggers and simulators, by windsysid"
    url = "https://pypi.org/project/windsysid"
    open_dataset_parameters = ("filename_or_obj", "drop_variables", "mapping", "section")

    def open_dataset(
        self,
        filename_or_obj: Any,
        *,
        drop_variables: str | Iterable[str] | None = None,
        mapping: Any = None,
        section: tuple[float, float] | None = None,
    ) -> xr.Dataset:
        """Read a file; `mapping` and `section` as for `windsysid.read_record`. Raises as it does."""
        dataset = read_record(filename_or_obj, mapping=mapping, section=section).to_xarray()
        dropped = [drop_variables] if isinstance(drop_variables, str) else list(drop_variables or ())
        return dataset.drop_vars([name for name in dropped if name in dataset], errors="ignore")

    def guess_can_open(self, filename_or_obj: Any) -> bool:
        """Test whether the name of a file has an ending that windsysid reads and no other engine does."""
        if not isinstance(filename_or_obj, str | Path):
            return False
        path = Path(filename_or_obj)
        return path.suffix.lower() not in _OTHERS and any(one.is_named(path) for one in FORMATS)
