"""Compiled functions that are passed by their address."""

import subprocess
import sys

CODE = """
import numba
from windsysid.filters.particles.cloud import _Address
from windsysid.kernels.jit import VALUE

class Some(_Address):
    def __init__(self):
        self.kind = VALUE

assert str(numba.typeof(Some())).startswith("FunctionType"), numba.typeof(Some())
"""


def test_numba_knows_the_type_of_an_address_before_anything_is_compiled():
    """A second run takes all its kernels from the cache and compiles nothing."""
    subprocess.run([sys.executable, "-c", CODE], check=True)
