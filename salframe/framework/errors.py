"""Errors that a user can cause. Each message is one line with the received value, the expected value and the fix."""

from __future__ import annotations

import difflib
from collections.abc import Callable, Sequence

MIN_SIMILARITY = 0.7
"""Minimum similarity of a suggested name to the unknown one, the ratio of difflib: 0 (no common letter) to 1 (equal).
A swap of two letters in a word of four has 0.75, and "matching" for "nothing" 0.67."""


class SalframeError(Exception):
    """Base class of errors that the command line prints as one line without a traceback."""


class ConfigError(SalframeError):
    """A configuration has an unknown key or an invalid value."""


class UnknownName(SalframeError):
    """No component, preset or dataset has this name."""


class PluginFailed(SalframeError):
    """The package that would provide a component could not be imported."""


class _Remediable(SalframeError):
    """An error that a command or a setting fixes.

    Attributes:
        remedy: The command or setting, such as "salframe weights fetch xfeat"; None if none is known.
        brief: The message without details such as hashes.
    """

    def __init__(self, message: str, remedy: str | None = None, brief: str | None = None) -> None:
        super().__init__(message)
        self.remedy, self.brief = remedy, message if brief is None else brief


class RequirementMissing(_Remediable):
    """A component needs a package that is not installed."""


class WeightsError(_Remediable):
    """The weights of a network are not installed, or are invalid."""


class DataError(SalframeError):
    """A dataset, image or manifest is missing, empty or malformed."""


class TruthMissing(DataError):
    """A query has no true place or pose. Only the evaluation needs them."""


class InputMissing(SalframeError):
    """A method needs something (colour, range, annotations) that a panorama does not have."""


class MethodFailed(SalframeError):
    """A method cannot continue. Its whole row in the table fails, not only the current item."""


class MethodUnavailable(MethodFailed):
    """A method does not support what a task requires."""


class InvalidAnswer(MethodFailed):
    """A component returned a result that its role does not allow."""


class WorkerDied(SalframeError):
    """A worker process ended before it returned a result."""

    def __init__(
        self, message: str = "the worker process died: it was killed, ran out of memory, or crashed in a library"
    ) -> None:
        super().__init__(message)


class NoRoute(SalframeError):
    """Two nodes of a topological map are not connected."""


FRAME_ERRORS = (DataError, InputMissing)
"""Errors that are caused by a frame, not by the method that processes it."""


def describe_error(error: BaseException) -> str:
    """Return an exception as one line.

    For errors of the file system: the file and the reason. For others: the message, with the type of the exception
    unless it is a SalframeError.
    """
    if isinstance(error, OSError) and error.strerror and error.filename is not None:
        return f"cannot use the file or folder {shorten(one_line(error.filename))}: {error.strerror}"
    message = one_line(error)
    return message if isinstance(error, SalframeError) else f"{type(error).__name__}: {message}".rstrip(": ")


def one_line(text: object) -> str:
    """Return a text, or the message of an exception, as one line with unprintable characters escaped."""
    message = " ".join(str(text).split())
    return message if message.isprintable() else "".join(c if c.isprintable() else repr(c)[1:-1] for c in message)


def shorten(text: str, max_length: int = 200) -> str:
    """Return the text, or its beginning and its length if it has more than `max_length` characters."""
    return text if len(text) <= max_length else f"{text[: max_length // 2]}... ({len(text)} characters)"


def failure_of(call: Callable[[], object]) -> str | None:
    """Call code that may belong to a plugin. Return its exception in one line, or None if it raised nothing.

    A KeyboardInterrupt is raised again.
    """
    try:
        call()
    except KeyboardInterrupt:
        raise
    except BaseException as error:
        return describe_error(error)
    return None


def suggest(name: str, known: Sequence[str]) -> str:
    """Return ", did you mean 'NAME'" with the known name that is closest to an unknown one; "" if none is close."""
    close = difflib.get_close_matches(name, known, 1, MIN_SIMILARITY)
    return f", did you mean {close[0]!r}" if close else ""


def unknown_key(noun: str, key: str, known: Sequence[str] | None, *, part: str | None = None, owner: str = "") -> str:
    """Return an error message for an unknown key or setting, with the closest name and all known names.

    Args:
        noun: The word in the message: "key" or "setting".
        key: The whole dotted key.
        known: The known names of the unknown part; None if they cannot be determined.
        part: The unknown part of the key; None for the last part.
        owner: Name of the component or key to which the setting should belong. The message contains it if `known` is
            empty.
    """
    if known:
        end = f"{suggest(part or key.rpartition('.')[2], known)} (known {noun}s: {', '.join(known)})"
    else:
        end = "" if known is None else f": {owner} has no settings"
    return f"unknown {noun} {key}{end}"


def unknown(what: str, name: str, known: Sequence[str], failures: Sequence[object] = ()) -> str:
    """Return the message for an unknown name: the closest name, the known names, and failed plugins."""
    listed = ", ".join(known[:30]) + (f", ... ({len(known)} in all)" if len(known) > 30 else "")
    suggestion = suggest(name, known)
    message = f"unknown {what} {name!r}{suggestion}{'?' if suggestion else '.'} Known: {listed or 'none'}."
    if failures:
        message += f" {counted(len(failures), 'plugin')} failed to load: {', '.join(map(str, failures))}."
    return message


def format_advice(received: object, present: int, older: str) -> str:
    """Return what to do about a file whose format (an integer) is not the present one: to update salframe if the format
    is newer, otherwise the advice `older`."""
    is_newer = isinstance(received, int) and received > present
    return "a newer version of salframe wrote it, pip install --upgrade salframe" if is_newer else older


def counted(count: int, noun: str) -> str:
    """Return a number and a noun, which is plural (with an "s" at the end of its first word) unless the number is 1."""
    word, space, rest = noun.partition(" ")
    return f"{count} {word}{'' if count == 1 else 's'}{space}{rest}"


def with_article(noun: str) -> str:
    """Return a noun with its indefinite article, such as "a detector" or "an engine"."""
    return f"{'an' if noun[:1] in 'aeiou' else 'a'} {noun}"


def content_type(content: object) -> str:
    """Return the type of the content of a YAML or JSON file in words."""
    names = {"NoneType": "no value", "str": "a string", "bool": "a boolean", "int": "a number", "float": "a number"}
    names |= {"list": "a list", "dict": "a mapping"}
    return names.get(type(content).__name__, f"a value of type {type(content).__name__}")
