"""A study whose cases do the worst that a case can do, each in its own way."""

import ctypes
import os
import signal
import sys
import time

from critflow.result import Status
from critflow.workflow import Axis, Study, Variable


class Unprintable(Exception):
    def __init__(self, first, second):  # cannot be unpickled from its message
        super().__init__("unprintable")

    def __str__(self):
        raise RuntimeError("no words")


class Outside(BaseException):
    """Not even an `Exception`."""


def leak():
    """Until the worker is ended; elsewhere it stops by itself."""
    held = []
    while len(held) < 64:
        held.append(bytearray(os.urandom(1) * 2**25))
        time.sleep(0.02)


def blow(error):
    raise error


HANG = 600
POISONS = {
    "raises": lambda: blow(ValueError("the poison\nacts")),
    "unprintable": lambda: blow(Unprintable(1, 2)),
    "outside": lambda: blow(Outside("outside")),
    "interrupts": lambda: blow(KeyboardInterrupt()),
    "surrogate": lambda: blow(ValueError("\udc80 and \0")),
    "talkative": lambda: blow(ValueError("x" * 10**6)),
    "exits": lambda: sys.exit(3),
    "returns_function": lambda: {"status": Status.ok, "number": lambda: 0},
    "returns_list": lambda: [1, 2],
    "returns_generator": lambda: {"status": Status.ok, "number": (i for i in range(3))},
    "returns_nonsense": lambda: {"status": 77},
    "recurses": lambda: POISONS["recurses"](),
    "quits": lambda: os._exit(1),
    "quits_twice": lambda: os._exit(1),
    "kills_itself": lambda: os.kill(os.getpid(), signal.SIGKILL),
    "aborts": lambda: os.abort(),
    "segfaults": lambda: ctypes.string_at(0),
    "leaks": leak,
    "hangs": lambda: time.sleep(HANG),
    "hangs_in_compiled_code": lambda: ctypes.PyDLL(None).sleep(HANG),  # with the interpreter's lock
    "stops": lambda: os.kill(os.getpid(), signal.SIGSTOP),
}


def case(parameters, *, kind, seed):
    if kind != "none" and seed == parameters["bad"]:
        if parameters["tally"]:
            with open(f"{parameters['tally']}-{kind}", "a+") as tally:
                tally.write("tried\n")
                tally.seek(0)
                tries = len(tally.readlines())
            if kind == "quits_twice" and tries > 2:
                return {"status": Status.ok, "number": seed}
        return POISONS[kind]()
    return {"status": Status.ok, "number": seed}


study = Study(
    name="poisoned",
    title="A study whose cases do their worst",
    axes=(
        Axis("kind", ("none",), "what the bad case does", choices=tuple(POISONS)),
        Axis("seed", range(3), "number of the case"),
    ),
    parameters={"bad": 1, "tally": ""},
    case=case,
    variables=(
        Variable("number", ("kind", "seed"), "i4", long_name="number of the case"),
        Variable("status", ("kind", "seed"), "i1", long_name="outcome", flags=Status),
    ),
)
