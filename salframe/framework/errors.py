"""Errors a user can cause. Each message is one line: what was received, what was expected, what to do."""

from __future__ import annotations

import difflib
from collections.abc import Callable, Sequence


class SalframeError(Exception):
    """Base of every error the command line prints as one line instead of a traceback."""


class ConfigError(SalframeError):
    """A configuration has an unknown key or a value of the wrong kind."""


class UnknownName(SalframeError):
    """No component, preset or dataset has this name."""


class PluginFailed(SalframeError):
    """The package that would provide a component could not be imported."""


class RequirementMissing(SalframeError):
    """A component needs a package that is not installed."""


class WeightsMissing(SalframeError):
    """A network's weights are not at hand."""


class DataError(SalframeError):
    """A dataset, image or manifest is missing, empty or malformed."""


class InputMissing(SalframeError):
    """A method needs something (colour, range, annotations) that a panorama does not have."""


class MethodFailed(SalframeError):
    """A method cannot go on: it costs its row in the table, not the piece of work at hand alone."""


class MethodUnavailable(MethodFailed):
    """A method cannot do what a task asks."""


class InvalidAnswer(MethodFailed):
    """A component answered what no component of its role may answer."""


class WorkerDied(SalframeError):
    """A process that worked ended before it had answered."""

    def __init__(self, message: str = "its process died: killed, out of memory, or a fault in a library") -> None:
        super().__init__(message)


class NoRoute(SalframeError):
    """Two nodes of a topological map are not connected."""


FRAME_ERRORS = (DataError, InputMissing)
"""What is wrong with a frame, not with the method that looks at it."""


def describe_error(error: BaseException) -> str:
    """An exception in one line."""
    said = one_line(error)
    return said if isinstance(error, SalframeError) else f"{type(error).__name__}: {said}".rstrip()


def one_line(error: BaseException) -> str:
    """What an exception says, in one line that every terminal can show: what it cannot stands escaped."""
    said = " ".join(str(error).split())
    return said if said.isprintable() else "".join(c if c.isprintable() else repr(c)[1:-1] for c in said)


def shorten(text: str, most: int = 200) -> str:
    """A text whose middle is left out where it has more than `most` characters."""
    return text if len(text) <= most else f"{text[: most // 2]}... ({len(text)} characters)"


def failure_of(call: Callable[[], object]) -> str | None:
    """Call what may be a plugin's own code: whatever it raised, in one line, None where it raised nothing. Only an
    interrupt of the user passes."""
    try:
        call()
    except KeyboardInterrupt:
        raise
    except BaseException as error:
        return describe_error(error)
    return None


def unknown(what: str, name: str, known: Sequence[str], failures: Sequence[object] = ()) -> str:
    """The message for a name that nobody has: the closest one, the list, and the plugins that failed to load."""
    close = difflib.get_close_matches(name, known, 1)
    listed = ", ".join(known[:30]) + (f", ... ({len(known)} in all)" if len(known) > 30 else "")
    hint = f", did you mean {close[0]!r}?" if close else "."
    message = f"unknown {what} {name!r}{hint} Known: {listed or 'none'}."
    if failures:
        message += f" {len(failures)} plugin(s) failed to load: {', '.join(map(str, failures))}."
    return message
