"""A study in which one case of each kind fails in a particular manner."""

import ctypes
import os
import signal
import sys
import time

from critflow.engine import Axis, Study, Variable
from critflow.result import Status


class Unprintable(Exception):
    def __init__(self, first, second):  # cannot be unpickled from its message
        super().__init__("unprintable")

    def __str__(self):
        raise RuntimeError("no message")


class Outside(BaseException):
    """Not an `Exception`."""


def leak():
    """Until the worker is ended; it stops by itself at two gigabytes."""
    blocks = []
    while len(blocks) < 64:
        blocks.append(bytearray(os.urandom(1) * 2**25))
        time.sleep(0.02)


def fail(error):
    raise error


HANG = 600
POISONS = {
    "raises": lambda: fail(ValueError("the poison\nacts")),
    "unprintable": lambda: fail(Unprintable(1, 2)),
    "outside": lambda: fail(Outside("outside")),
    "surrogate": lambda: fail(ValueError("\udc80 and \0")),
    "long": lambda: fail(ValueError("x" * 10**6)),
    "exits": lambda: sys.exit(3),
    "returns_function": lambda: {"status": Status.ok, "number": lambda: 0},
    "returns_list": lambda: [1, 2],
    "recurses": lambda: POISONS["recurses"](),
    "kills_itself": lambda: os.kill(os.getpid(), signal.SIGKILL),
    "leaks": leak,
    "hangs_in_compiled_code": lambda: ctypes.PyDLL(None).sleep(HANG),  # with the interpreter's lock
    "kills_itself_once": lambda: os.kill(os.getpid(), signal.SIGKILL),
}


def case(parameters, *, kind, seed):
    if kind != "none" and seed == parameters["bad"]:
        mark = os.path.join(os.environ.get("CRITFLOW_TEST_MARKS", os.devnull), kind)
        good = os.path.exists(mark)
        if kind == "kills_itself_once" and not good:
            open(mark, "w").close()
        if not (good and kind == "kills_itself_once"):
            return POISONS[kind]()
    return {"status": Status.ok, "number": seed}


study = Study(
    name="poisoned",
    title="A study whose cases fail",
    axes=(Axis("kind", ("none", *POISONS), "how the bad case fails"), Axis("seed", range(3), "number of the case")),
    parameters={"bad": 1, "label": ""},
    case=case,
    variables=(
        Variable("number", ("kind", "seed"), "i4", long_name="number of the case"),
        Variable("status", ("kind", "seed"), "i1", long_name="outcome", flags=Status),
    ),
)
