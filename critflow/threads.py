"""One thread of BLAS inside public calls, so that their digits and times do not depend on the other processes.

Dense matrices of this library are small: threads of BLAS that wait for each other while processes are busy take seconds
for what one does in milliseconds.
"""

from __future__ import annotations

from contextlib import nullcontext
from functools import cache
from typing import Any

from threadpoolctl import ThreadpoolController


@cache
def _controller() -> ThreadpoolController:
    # To find the libraries takes milliseconds, to set their threads microseconds.
    return ThreadpoolController()


def one_thread() -> Any:
    """A context in which BLAS uses one thread; calls inside it find it so, and set nothing."""
    controller = _controller()
    blas = (library.num_threads for library in controller.lib_controllers if library.user_api == "blas")
    return nullcontext() if all(n == 1 for n in blas) else controller.limit(limits=1, user_api="blas")
