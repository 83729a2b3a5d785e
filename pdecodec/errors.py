"""The errors that pdecodec raises on purpose: one root, a few classes, and data that distinguish cases.

The message of an error says in one line what happened, where, and what to do. Programs read its class, `code` and
fields, never its text. The library calls settings by the names of its parameters; the command line replaces these
names by its options and turns classes into exit codes. The library never exits and never prints.
"""

from __future__ import annotations

import errno
import os
from collections.abc import Iterator
from contextlib import contextmanager
from enum import StrEnum
from typing import Any, Self


class ErrorCode(StrEnum):
    """The kind of failure, for programs. Values never change; later versions may add some (`docs/errors.md`)."""

    description: str

    def __new__(cls, value: str, description: str = "") -> ErrorCode:
        member = str.__new__(cls, value)
        member._value_ = value
        member.description = description
        return member

    FAILED = "failed", "A failure without a code of its own."

    INVALID_SETTING = "invalid-setting", "A setting or an argument has the wrong type or is out of range."
    CONFLICTING_SETTINGS = "conflicting-settings", "Settings contradict each other."
    SETTING_UNSUPPORTED = "setting-unsupported", "A setting does not apply to this format or kind of input."
    UNKNOWN_NAME = "unknown-name", "A setting names something that does not exist: a scene, an option, a section."
    FRAME_OUT_OF_RANGE = "frame-out-of-range", "The requested frames are not in the sequence."
    TIME_OUT_OF_RANGE = "time-out-of-range", "A requested time lies outside the clip."

    INVALID_INPUT = "invalid-input", "An input has a wrong type or shape, or is inconsistent."
    INVALID_FACES = (
        "invalid-faces",
        "Faces or lines refer to vertices that do not exist, have too few points, or their counts do not add up.",
    )
    INVALID_ATTRIBUTE = (
        "invalid-attribute",
        "An attribute does not match its domain, or refers to rows that do not exist.",
    )
    INVALID_FIELD = "invalid-field", "A field does not match its domain or the frames, or is of an unknown type."
    FILE_MISSING = "file-missing", "A file, folder or address does not exist."
    UNREADABLE = "unreadable", "A file cannot be opened or read: missing permission, a pipe or device, a failing disk."
    OUTSIDE_FOLDER = "outside-folder", "A file refers to a file outside its folder, which is not allowed."
    UNKNOWN_FORMAT = "unknown-format", "The format of a file is unknown, or is not the one of its extension."
    UNSUPPORTED_FORMAT = "unsupported-format", "The format is known but cannot be read or written here."
    AMBIGUOUS_INPUT = "ambiguous-input", "A name matches several files, sequences or objects."
    FRAME_MISSING = "frame-missing", "A frame is missing in a sequence of files."
    NO_FRAMES = "no-frames", "There is no frame, or no file matches."
    NO_VERTICES = "no-vertices", "There is no vertex, or no object has one."
    DAMAGED_INPUT = "damaged-input", "A file of another format is damaged, truncated or invalid."
    FILE_CHANGED = "file-changed", "A file was changed or closed while it was being read."
    UNSUPPORTED_FEATURE = "unsupported-feature", "A file uses a feature of its format that is not supported."
    OBJECT_MISSING = "object-missing", "There is no object with this name."
    OBJECT_MISMATCH = "object-mismatch", "Two files do not match: their objects, vertices, faces, axes or units differ."
    CONNECTIVITY_CHANGES = "connectivity-changes", "The connectivity changes where it must be constant."
    INVALID_TIMES = "invalid-times", "Times or a frame rate are not finite, do not increase, or are too many."
    NOT_FINITE = "not-finite", "A position or another number is infinite or not a number."
    TOO_LARGE = "too-large", "There is more data than the output format or the codec can hold."
    INTERRUPTED = "interrupted", "The work was interrupted before it was done."
    WORKER_ENDED = "worker-ended", "A worker process ended, or could not be started."

    OUTPUT_EXISTS = "output-exists", "The output exists already."
    OUTPUT_UNWRITABLE = "output-unwritable", "The output cannot be written."
    DISK_FULL = "disk-full", "There is no space left on the output's disk."
    OVERWRITES_INPUT = "overwrites-input", "An output would replace an input or another output."

    CORRUPT_FILE = "corrupt-file", "A .pdeanim file is damaged or inconsistent."
    IDENTIFIER = "identifier", "The first bytes are not those of a .pdeanim file."
    VERSION = "version", "The file has a later major version of the format."
    HEADER_CHECKSUM = "header-checksum", "The header is damaged."
    TABLE = "table", "The table of sections cannot be read."
    TABLE_CHECKSUM = "table-checksum", "The table of sections is damaged."
    TRUNCATED = "truncated", "The file ends before its last section does."
    TRAILING_BYTES = "trailing-bytes", "There are bytes after the last section."
    SECTION_UNKNOWN = "section-unknown", "A section of a later minor version, which readers may skip: a note."
    SECTION_UNKNOWN_REQUIRED = (
        "section-unknown-required",
        "A section of a later version that readers must understand.",
    )
    SECTION_CHECKSUM = "section-checksum", "The bytes of a section differ from those that were written."
    SECTION_CONTENT = (
        "section-content",
        "A section is missing or invalid: a count, a range, or a value that contradicts another section.",
    )
    GROUP_CHECKSUM = "group-checksum", "The bytes of a group of frames differ from those that were written."
    GROUP_CONTENT = "group-content", "A group of frames cannot be decoded."
    MEMORY_LIMIT = "memory-limit", "Reading needs more memory than `max_memory` allows; the rest was not checked."
    OUTPUT_LIMIT = "output-limit", "The file declares more positions than `max_output` allows."

    MISSING_EXTRA = "missing-extra", "An optional package is not installed."


FIELDS = (
    *("message", "code", "path", "object", "frame", "section", "offset"),
    *("limit", "setting", "value", "purpose"),
)
"""The names of an error's arguments and attributes."""


LONGEST_MESSAGE = 2000
"""Longest message [characters]; longer ones lose their middle."""


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
        The file concerned.
    object : str, optional
        The name of the object concerned.
    frame : int, optional
        The index of the frame concerned (position in the sequence from 0).
    section : str, optional
        The four letters of the section concerned of a `.pdeanim` file.
    offset : int, optional
        The offset of the byte concerned in the file.
    limit : str, optional
        The setting that limits what was requested; a higher value allows it.
    setting : str, optional
        The setting that would help, by its name in the library's functions; for a :class:`SettingsError` the wrong one.
    value : object, optional
        The value to set `setting` to.
    purpose : str, optional
        What setting it does, such as "to replace it".
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
            # Texts from a damaged file may have any length.
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
        """Return the message, with another name for the setting or the limit.

        Parameters
        ----------
        name : str
            The name, such as "fps" or "--fps".
        remedy : str
            How to give the setting, such as "set fps=24" or "pass --fps 24".
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
        """Return a copy with another place or message; arguments that are None keep the present value."""
        changes = {"message": message, "path": path, "object": object, "frame": frame}
        return type(self)(**self.fields() | {name: value for name, value in changes.items() if value is not None})

    def fields(self) -> dict[str, Any]:
        """Return the arguments that recreate the error, without those that are None, as JSON can hold them."""
        return {name: getattr(self, name) for name in FIELDS if getattr(self, name) is not None}


class Notice(str):
    """Information from a reader or a writer for people, and the setting that changes the result.

    Parameters
    ----------
    text : str
    setting, value, purpose
        As in :class:`PdecodecError`.
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
        """Return the message, with another name for the setting: see :meth:`PdecodecError.worded`."""
        return f"{self.text}; {remedy} {self.purpose}"


class SettingsError(PdecodecError):
    """Settings or arguments contradict each other or are out of range; the message follows the name in `setting`."""

    exit_code = 2
    default_code = ErrorCode.INVALID_SETTING

    def worded(self, name: str, remedy: str) -> str:
        return self._place() + (self.message if self.setting is None else f"{name} {self.message}")


class InputError(PdecodecError):
    """An input (mesh, sequence, or path to write to) that cannot be used as it is."""

    exit_code = 3
    default_code = ErrorCode.INVALID_INPUT

    def __new__(cls, message: str = "", **fields: Any) -> Self:
        if cls is InputError and fields.get("code") == ErrorCode.FILE_MISSING:
            return MissingFileError.__new__(MissingFileError, message, **fields)  # type: ignore[return-value]
        return super().__new__(cls, message)


class MissingFileError(InputError, FileNotFoundError):
    """A file, folder or address does not exist: :class:`InputError` with code "file-missing" becomes this class."""

    default_code = ErrorCode.FILE_MISSING

    def __init__(self, message: str, **fields: Any) -> None:
        super().__init__(message, **fields)
        self.errno, self.strerror, self.filename = errno.ENOENT, self.message, self.path


class CorruptFileError(PdecodecError):
    """A `.pdeanim` file is damaged, truncated, or another kind of file."""

    exit_code = 4
    default_code = ErrorCode.CORRUPT_FILE


class LimitError(CorruptFileError):
    """A `.pdeanim` file needs more memory than the limit allows."""

    default_code = ErrorCode.MEMORY_LIMIT


class MissingExtraError(PdecodecError):
    """An optional dependency is not installed; the message names the command that installs it."""

    exit_code = 5
    default_code = ErrorCode.MISSING_EXTRA


def damaged(
    message: str, *, path: str | os.PathLike[str] | None = None, frame: int | None = None, offset: int | None = None
) -> InputError:
    """Return the error for a file of another format that is damaged or invalid."""
    return InputError(message, code=ErrorCode.DAMAGED_INPUT, path=path, frame=frame, offset=offset)


def unreadable(
    error: Exception, path: str | os.PathLike[str], advice: str = "", *, doing: str = "read", frame: int | None = None
) -> InputError:
    """Return the error for a file that the system cannot open, read or write.

    Parameters
    ----------
    error : Exception
        The system's exception.
    path : path-like
    advice : str
        What to do, such as "check the name".
    doing : {"read", "opened", "written"}
        The action that failed.
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
    """Add the file's path to errors from code that does not know it."""
    try:
        yield
    except (InputError, MissingExtraError) as error:
        if error.path is not None:
            raise
        raise error.placed(path=path) from error
