"""A wheel's machine code is used where it fits, and nowhere else."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
from llvmlite import binding

from windsysid.kernels import cache

USE = """
import sys
from pathlib import Path
from windsysid.kernels import cache, jit
cache.SHIPPED = Path(sys.argv[1])
jit.something_is_compiled = lambda: print("compiled")
from windsysid.kernels.philox import _uniform
print(_uniform() is not None)
"""


def python(cache_folder: Path, *arguments: str, portable: bool = False) -> str:
    surrounding = os.environ | {"WINDSYSID_CACHE": str(cache_folder)}
    if portable:
        name = cache.portable_processor(binding.get_process_triple())
        if name is None:
            pytest.skip("a processor that cannot run portable code")
        surrounding |= {"NUMBA_CPU_NAME": name, "NUMBA_CPU_FEATURES": ""}
    ended = subprocess.run([sys.executable, *arguments], env=surrounding, capture_output=True, text=True, check=True)
    return ended.stdout


@pytest.fixture(scope="module")
def shipped(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """One kernel, compiled as for a wheel."""
    folder = tmp_path_factory.mktemp("wheel")
    python(folder, "-m", "windsysid.kernels.ahead", "windsysid.kernels.philox:_uniform", portable=True)
    return folder


def test_a_shipped_kernel_is_used_and_nothing_is_compiled(shipped: Path, tmp_path: Path):
    assert python(tmp_path, "-c", USE, str(shipped)) == "True\n"
    assert not list(tmp_path.rglob("*.kernel"))


@pytest.mark.slow
def test_without_its_file_or_with_a_damaged_one_the_kernel_is_compiled(shipped: Path, tmp_path: Path):
    assert python(tmp_path / "a", "-c", USE, str(tmp_path)) == "compiled\nTrue\n"
    (tmp_path / "kernels").mkdir()
    (file,) = shipped.rglob("*.kernel")
    (tmp_path / "kernels" / file.name).write_bytes(file.read_bytes()[:-1])
    assert python(tmp_path / "b", "-c", USE, str(tmp_path)) == "compiled\nTrue\n"


def test_a_processor_that_lacks_an_instruction_runs_no_shipped_code(monkeypatch: pytest.MonkeyPatch):
    every = dict.fromkeys(cache._PORTABLE["x86_64"][1], True)
    monkeypatch.setattr(binding, "get_host_cpu_features", lambda: every)
    assert cache.portable_processor("x86_64-unknown-linux-gnu") == "x86-64-v3"
    for one in every:
        monkeypatch.setattr(binding, "get_host_cpu_features", lambda one=one: every | {one: False})
        assert cache.portable_processor("x86_64-unknown-linux-gnu") is None
    assert cache.portable_processor("riscv64-unknown-linux-gnu") is None
