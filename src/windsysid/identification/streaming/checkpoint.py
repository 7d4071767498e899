"""Checkpoint of a streaming identification: a NumPy archive that appears whole or not at all.

It names the call that wrote it, so that another call does not resume from it.
"""

import json
import zipfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from windsysid.errors import ConfigurationError, WindsysidError
from windsysid.output.files import claim_file

__all__ = ["Checkpoint"]

LAYOUT = 2
"""Setting: number of the archive's layout: another one is refused."""


class Checkpoint(NamedTuple):
    """A file from which an interrupted call resumes.

    Attributes
    ----------
    path
        The file.
    call
        What must be the same for the call to resume: names and plain values.
    """

    path: Path
    call: Mapping[str, Any]

    def write(self, arrays: Mapping[str, Any], progress: Mapping[str, Any]) -> None:
        """Replace the file by arrays, and names with plain values."""
        plain = {"call": dict(self.call), "progress": dict(progress), "layout": LAYOUT}
        content: dict[str, Any] = {**arrays, **{name: np.asarray(json.dumps(value)) for name, value in plain.items()}}
        with claim_file(self.path, overwrite=True) as write:
            write(lambda file: np.savez(file, **content))

    def progress(self) -> dict[str, Any] | None:
        """The progress that was written last; None where there is no file.

        Raises
        ------
        ConfigurationError
            If the file is no checkpoint, is of an earlier layout, or belongs to another call; the line names what
            differs.
        """
        if not self.path.exists():
            return None
        with self.opened() as archive:
            if "layout" not in archive or json.loads(str(archive["layout"])) != LAYOUT:
                raise ConfigurationError(
                    f"{self.path}: expected a checkpoint of this version, got one of an earlier version: delete it to "
                    "begin anew"
                )
            before, now = json.loads(str(archive["call"])), json.loads(json.dumps(self.call))
            progress: dict[str, Any] = json.loads(str(archive["progress"]))
        differ = [name for name in now if before.get(name) != now[name]]
        if differ:
            raise self.of_another_call(differ)
        return progress

    @contextmanager
    def opened(self) -> Iterator[Mapping[str, Any]]:
        """The arrays of the file; ConfigurationError if it is no checkpoint, or the arrays are another problem's."""
        try:
            with np.load(self.path, allow_pickle=False) as archive:
                yield archive
        except WindsysidError:
            raise
        except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile) as error:
            raise ConfigurationError(
                f"{self.path}: expected a checkpoint of this version, got something else ({error}): "
                f"delete it to begin anew"
            ) from None

    def of_another_call(self, differ: Sequence[str]) -> ConfigurationError:
        """The refusal of a file that belongs to another call."""
        return ConfigurationError(
            f"{self.path}: was left by another call, which differs in {', '.join(differ)}: repeat that call, choose "
            f"another output, or delete the checkpoint to begin anew"
        )
