"""Errors that pdecodec raises on purpose: one root, a few classes, and data that tell cases apart.

An error says in one line what happened, where, and what to do. Programs look at its class, `code` and fields, never at
its words. The library names settings as its functions call them; the command line puts its options in their place and
turns classes into exit codes. The library never exits and never prints.
"""

from __future__ import annotations

import errno
import os
from collections.abc import Iterator
from contextlib import contextmanager
from enum import StrEnum
from typing import Any, Self


class ErrorCode(StrEnum):
    """What went wrong, for programs: values never change, later versions may add some (`docs/errors.md`)."""

    description: str

    def __new__(cls, value: str, description: str = "") -> ErrorCode:
        member = str.__new__(cls, value)
        member._value_ = value
        member.description = description
        return member

    FAILED = "failed", "Something failed that has no code of its own."

    INVALID_SETTING = "invalid-setting", "A setting or an argument is of a wrong kind or out of range."
    CONFLICTING_SETTINGS = "conflicting-settings", "Settings contradict each other."
    SETTING_UNSUPPORTED = "setting-unsupported", "A setting is not for this format or kind of input."
    UNKNOWN_NAME = "unknown-name", "A setting names something that does not exist: a scene, an option, a section."
    FRAME_OUT_OF_RANGE = "frame-out-of-range", "The frames asked for are not in the sequence."
    TIME_OUT_OF_RANGE = "time-out-of-range", "A time asked for lies outside the clip."

    INVALID_INPUT = "invalid-input", "An input has a wrong type or shape, or contradicts itself."
    INVALID_FACES = (
        "invalid-faces",
        "Faces or lines refer to vertices that do not exist, have too few points, or their counts do not add up.",
    )
    INVALID_ATTRIBUTE = "invalid-attribute", "An attribute does not fit its domain, or the rows that it refers to."
    FILE_MISSING = "file-missing", "There is no such file, folder or address."
    UNREADABLE = "unreadable", "A file cannot be opened or read: access rights, a pipe or a device, a failing disk."
    OUTSIDE_FOLDER = "outside-folder", "A file names another one outside its folder, which was not allowed."
    UNKNOWN_FORMAT = "unknown-format", "The format of a file is not known, or not what its name says."
    UNSUPPORTED_FORMAT = "unsupported-format", "A known format that cannot be read or written here."
    AMBIGUOUS_INPUT = "ambiguous-input", "A name stands for several files, sequences or objects."
    FRAME_MISSING = "frame-missing", "A frame of a sequence of files is missing."
    NO_FRAMES = "no-frames", "There is no frame, or no file that matches."
    NO_VERTICES = "no-vertices", "There is no vertex, or no object that has any."
    DAMAGED_INPUT = "damaged-input", "A file of another format is damaged, truncated or breaks its format."
    FILE_CHANGED = "file-changed", "A file was changed or closed while it was read."
    UNSUPPORTED_FEATURE = "unsupported-feature", "A file uses a feature of its format that is not supported."
    OBJECT_MISSING = "object-missing", "There is no object of this name."
    OBJECT_MISMATCH = "object-mismatch", "Two files do not fit: objects, vertices, faces, axes or units differ."
    CONNECTIVITY_CHANGES = "connectivity-changes", "The connectivity changes where it must be constant."
    INVALID_TIMES = "invalid-times", "Times or a frame rate are not finite, do not increase, or are too many."
    NOT_FINITE = "not-finite", "A position or another number is infinite or no number."
    TOO_LARGE = "too-large", "More than the format to write, or the codec, can hold."
    INTERRUPTED = "interrupted", "The work was stopped before it was done."
    WORKER_ENDED = "worker-ended", "A process that did the work ended, or could not be started."

    OUTPUT_EXISTS = "output-exists", "The place to write to is taken."
    OUTPUT_UNWRITABLE = "output-unwritable", "The place to write to cannot be written to."
    DISK_FULL = "disk-full", "There is no space left to write to."
    OVERWRITES_INPUT = "overwrites-input", "An output would replace a file that is read, or another output."

    CORRUPT_FILE = "corrupt-file", "A .pdeanim file is damaged or does not hold what it should."
    IDENTIFIER = "identifier", "The first bytes are not those of a .pdeanim file."
    VERSION = "version", "The file is of a later major version of the format."
    HEADER_CHECKSUM = "header-checksum", "The header is damaged."
    TABLE = "table", "The table of sections cannot be read."
    TABLE_CHECKSUM = "table-checksum", "The table of sections is damaged."
    TRUNCATED = "truncated", "The file ends before its last section does."
    TRAILING_BYTES = "trailing-bytes", "There are bytes after the last section."
    SECTION_UNKNOWN = "section-unknown", "A section of a later minor version, which may be passed over: a note."
    SECTION_UNKNOWN_REQUIRED = (
        "section-unknown-required",
        "A section of a later version, without which the file must not be read.",
    )
    SECTION_CHECKSUM = "section-checksum", "The bytes of a section are not those that were written."
    SECTION_CONTENT = (
        "section-content",
        "A section breaks the format, or is missing: counts, ranges, what must agree with others.",
    )
    GROUP_CHECKSUM = "group-checksum", "The bytes of a group of frames are not those that were written."
    GROUP_CONTENT = "group-content", "A group of frames cannot be decoded."
    MEMORY_LIMIT = "memory-limit", "More memory is needed than `max_memory` allows; the rest was not looked at."
    OUTPUT_LIMIT = "output-limit", "The file declares more positions than `max_output` allows."

    MISSING_EXTRA = "missing-extra", "An optional package is not installed."


FIELDS = (
    *("message", "code", "path", "object", "frame", "section", "offset"),
    *("limit", "setting", "value", "purpose"),
)
"""What an error carries: its arguments and attributes."""


LONGEST_MESSAGE = 2000
"""Characters of a message; of longer ones the middle is left out."""


def _remedy(setting: str, value: object) -> str:
    return f"set {setting}" if value is None else f"set {setting}={value}"


class PdecodecError(Exception):
    """Root of every error that pdecodec raises on purpose.

    Parameters
    ----------
    message : str
        One line: what is wrong and what to do, without the place and the setting.
    code : ErrorCode or str, optional
        Default: that of the class.
    path : str or os.PathLike, optional
        The file it concerns.
    object : str, optional
        Name of the object it concerns.
    frame : int, optional
        The frame index (0-based position in the sequence) it concerns.
    section : str, optional
        Four letters of the section of a `.pdeanim` file it concerns.
    offset : int, optional
        The byte offset in the file it concerns.
    limit : str, optional
        The setting that limits what was asked for; a higher value allows it.
    setting : str, optional
        The setting that would help, as the library's functions call it; of a :class:`SettingsError` the one that is
        wrong.
    value : object, optional
        What to set `setting` to.
    purpose : str, optional
        What setting it does, as "to replace it".
    """

    exit_code = 1
    default_code = ErrorCode.FAILED

    def __init__(
        self,
        message: str,
        *,
        code: ErrorCode | str | None = None,
        path: str | os.PathLike[str] | None = None,
        object: str | None = None,
        frame: int | None = None,
        section: str | None = None,
        offset: int | None = None,
        limit: str | None = None,
        setting: str | None = None,
        value: str | float | None = None,
        purpose: str | None = None,
    ) -> None:
        if len(message) > LONGEST_MESSAGE:
            # What a damaged file says of itself may be of any length.
            message = f"{message[: LONGEST_MESSAGE // 2]} ... {message[-LONGEST_MESSAGE // 2 :]}"
        super().__init__(message)
        self.message = message
        self.code = self.default_code if code is None else ErrorCode(code)
        self.path = None if path is None else os.fsdecode(path)
        self.object, self.frame, self.section, self.offset = object, frame, section, offset
        self.limit, self.setting, self.value, self.purpose = limit, setting, value, purpose

    def __str__(self) -> str:
        name = self.limit or self.setting or ""
        return self.worded(name, _remedy(name, self.value))

    def worded(self, name: str, remedy: str) -> str:
        """Return the line, with the setting or the limit under another name.

        Parameters
        ----------
        name : str
            The setting, as "fps" or "--fps".
        remedy : str
            How the setting is given, as "set fps=24" or "pass --fps 24".
        """
        text = self.message
        if self.limit is not None:
            text += f"; raise {name} if you trust the file"
        elif self.setting is not None:
            text += f"; {remedy}" + ("" if self.purpose is None else f" {self.purpose}")
        return self._place() + text

    def _place(self) -> str:
        place = [] if self.path is None else [self.path]
        if self.object is not None:
            place.append(f"object {self.object!r}")
        if self.frame is not None:
            place.append(f"frame {self.frame}")
        if self.offset is not None:
            place.append(f"byte {self.offset}")
        return f"{', '.join(place)}: " if place else ""

    def placed(
        self,
        message: str | None = None,
        *,
        path: str | os.PathLike[str] | None = None,
        object: str | None = None,
        frame: int | None = None,
    ) -> Self:
        """Return a copy with another place or message; what is None stays."""
        changes = {"message": message, "path": path, "object": object, "frame": frame}
        return type(self)(**self.fields() | {name: value for name, value in changes.items() if value is not None})

    def fields(self) -> dict[str, Any]:
        """Return the arguments that make the error again, those that are not None, as JSON holds them."""
        return {name: getattr(self, name) for name in FIELDS if getattr(self, name) is not None}


class Notice(str):
    """What a reader or a writer wants people to know, and the setting that changes it.

    Parameters
    ----------
    text : str
    setting, value, purpose
        As of a :class:`PdecodecError`.
    """

    limit = None
    text: str
    setting: str | None
    value: str | None
    purpose: str

    def __new__(cls, text: str, *, setting: str | None = None, value: str | None = None, purpose: str = "") -> Notice:
        shown = text if setting is None else f"{text}; {_remedy(setting, value)} {purpose}"
        made = super().__new__(cls, shown)
        made.text, made.setting, made.value, made.purpose = text, setting, value, purpose
        return made

    def worded(self, name: str, remedy: str) -> str:
        """Return the line, with the setting under another name: see :meth:`PdecodecError.worded`."""
        return f"{self.text}; {remedy} {self.purpose}"


class SettingsError(PdecodecError):
    """Settings or arguments that contradict themselves or lie out of range; the message follows `setting`."""

    exit_code = 2
    default_code = ErrorCode.INVALID_SETTING

    def worded(self, name: str, remedy: str) -> str:
        return self._place() + (self.message if self.setting is None else f"{name} {self.message}")


class InputError(PdecodecError):
    """An input (mesh, sequence, or place to write to) that cannot be used as it is."""

    exit_code = 3
    default_code = ErrorCode.INVALID_INPUT

    def __new__(cls, message: str = "", **fields: Any) -> Self:
        if cls is InputError and fields.get("code") == ErrorCode.FILE_MISSING:
            return MissingFileError.__new__(MissingFileError, message, **fields)  # type: ignore[return-value]
        return super().__new__(cls, message)


class MissingFileError(InputError, FileNotFoundError):
    """A file, folder or address that does not exist: what :class:`InputError` becomes with code "file-missing"."""

    default_code = ErrorCode.FILE_MISSING

    def __init__(self, message: str, **fields: Any) -> None:
        super().__init__(message, **fields)
        self.errno, self.strerror, self.filename = errno.ENOENT, self.message, self.path


class CorruptFileError(PdecodecError):
    """A `.pdeanim` file that is damaged, truncated or not one at all."""

    exit_code = 4
    default_code = ErrorCode.CORRUPT_FILE


class LimitError(CorruptFileError):
    """A `.pdeanim` file that asks for more memory than the documented limit."""

    default_code = ErrorCode.MEMORY_LIMIT


class MissingExtraError(PdecodecError):
    """An optional dependency that is not installed; the message names the command that installs it."""

    exit_code = 5
    default_code = ErrorCode.MISSING_EXTRA


def damaged(
    message: str, *, path: str | os.PathLike[str] | None = None, frame: int | None = None, offset: int | None = None
) -> InputError:
    """Return the error about a file of another format that is damaged or breaks its format."""
    return InputError(message, code=ErrorCode.DAMAGED_INPUT, path=path, frame=frame, offset=offset)


def unreadable(
    error: Exception, path: str | os.PathLike[str], advice: str = "", *, doing: str = "read", frame: int | None = None
) -> InputError:
    """Return the error about a file that the system cannot open, read or write.

    Parameters
    ----------
    error : Exception
        What the system raised.
    path : path-like
    advice : str
        What to do, as "check the name".
    doing : {"read", "opened", "written"}
        What failed.
    frame : int, optional
    """
    number = error.errno if isinstance(error, OSError) else None
    code = ErrorCode.OUTPUT_UNWRITABLE if doing == "written" else ErrorCode.UNREADABLE
    code = {errno.ENOENT: ErrorCode.FILE_MISSING, errno.ENOSPC: ErrorCode.DISK_FULL}.get(number or 0, code)
    reason = getattr(error, "strerror", None) or error
    message = f"cannot be {doing} ({reason})" + (f"; {advice}" if advice else "")
    return InputError(message, code=code, path=path, frame=frame)


@contextmanager
def naming_file(path: str | os.PathLike[str]) -> Iterator[None]:
    """Name the file in errors of code that knows only arrays and positions."""
    try:
        yield
    except (InputError, MissingExtraError) as error:
        if error.path is not None:
            raise
        raise error.placed(path=path) from error
