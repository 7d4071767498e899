"""One thread for products of matrices, and as many as before afterwards."""

import pytest

from windsysid.kernels import threads
from windsysid.kernels.threads import one_thread


def test_numpy_multiplies_in_one_thread_and_gets_its_threads_back() -> None:
    controls = threads._controls()
    if not controls:
        pytest.skip("NumPy was built with another library than OpenBLAS")

    @one_thread()
    def failing() -> None:
        raise ValueError(str([read() for read, _ in controls]))

    before = [read() for read, _ in controls]
    try:
        for _, write in controls:
            write(2)
        with pytest.raises(ValueError, match=r"^\[1(, 1)*\]$"):
            failing()
        assert [read() for read, _ in controls] == [2] * len(controls)
    finally:
        for (_, write), number in zip(controls, before, strict=True):
            write(number)
