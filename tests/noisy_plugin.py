"""A localizer that prints wherever it can, through Python and past it, and a command of a plugin."""

from __future__ import annotations

import os

from fake_plugin import Reader

import salframe

print("noisy is imported")
os.write(1, b"noisy is imported, says the library below\n")


class Noisy(Reader):
    """Prints when it describes and when it matches."""

    name = "noisy"

    def describe(self, panorama):
        print("noisy describes")
        os.write(1, b"noisy describes, says the library below\n")
        return super().describe(panorama)

    def match(self, description):
        print("noisy matches", flush=True)
        return super().match(description)


def shout(word: str = "hello", times: int = 1) -> None:
    """Print a word in capitals."""
    print(" ".join([word.upper()] * times))


@salframe.hookimpl
def salframe_provides():
    return [Noisy]


@salframe.hookimpl
def salframe_commands():
    return {"shout": shout}
